#include "calib/colour/lab.h"

#include <Eigen/Dense>
#include <cmath>

namespace lightstage::calib {

namespace {

constexpr Triple kD50{0.96422, 1, 0.82521}, kD65{0.95047, 1, 1.08883};  // ICC's and Rec. 709's white

Eigen::Vector3d vector(const Triple& v) {
  return {v[0], v[1], v[2]};
}

// XYZ of D65 light from linear Rec. 709: the matrix whose columns are the primaries, each so strong that together they make the white.
Eigen::Matrix3d xyz_from_rec709() {
  const double primaries[3][2] = {{0.64, 0.33}, {0.30, 0.60}, {0.15, 0.06}};
  Eigen::Matrix3d columns;
  for (int c = 0; c < 3; ++c) {
    const double x = primaries[c][0], y = primaries[c][1];
    columns.col(c) << x / y, 1, (1 - x - y) / y;
  }
  const Eigen::Vector3d strength = columns.inverse() * vector(kD65);
  return columns * strength.asDiagonal();
}

Eigen::Matrix3d d50_from_d65() {
  Eigen::Matrix3d bradford;
  bradford << 0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296;
  const Eigen::Vector3d scale = (bradford * vector(kD50)).cwiseQuotient(bradford * vector(kD65));
  return bradford.inverse() * scale.asDiagonal() * bradford;
}

const Eigen::Matrix3d& xyz_d50_from_rec709() {
  static const Eigen::Matrix3d matrix = d50_from_d65() * xyz_from_rec709();
  return matrix;
}

constexpr double kKnee = 6.0 / 29;

double curve(double t) {
  return t > kKnee * kKnee * kKnee ? std::cbrt(t) : t / (3 * kKnee * kKnee) + 4.0 / 29;
}
double inverse_curve(double f) {
  return f > kKnee ? f * f * f : 3 * kKnee * kKnee * (f - 4.0 / 29);
}

}  // namespace

Triple lab_from_rec709(const Triple& rgb) {
  const Eigen::Vector3d xyz = xyz_d50_from_rec709() * vector(rgb);
  const double x = curve(xyz[0] / kD50[0]), y = curve(xyz[1] / kD50[1]), z = curve(xyz[2] / kD50[2]);
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

Triple rec709_from_lab(const Triple& lab) {
  const double y = (lab[0] + 16) / 116, x = y + lab[1] / 500, z = y - lab[2] / 200;
  const Eigen::Vector3d xyz(kD50[0] * inverse_curve(x), kD50[1] * inverse_curve(y), kD50[2] * inverse_curve(z));
  const Eigen::Vector3d rgb = xyz_d50_from_rec709().inverse() * xyz;
  return {rgb[0], rgb[1], rgb[2]};
}

double delta_e_2000(const Triple& lab1, const Triple& lab2) {
  const auto degrees = [](double radians) { return radians * 180 / M_PI; };
  const auto radians = [](double deg) { return deg * M_PI / 180; };
  const double mean_chroma = (std::hypot(lab1[1], lab1[2]) + std::hypot(lab2[1], lab2[2])) / 2;
  const double g = 0.5 * (1 - std::sqrt(std::pow(mean_chroma, 7) / (std::pow(mean_chroma, 7) + std::pow(25.0, 7))));
  const auto hue_of = [&](double a, double b) {
    if (a == 0 && b == 0) return 0.0;
    const double hue = degrees(std::atan2(b, a));
    return hue < 0 ? hue + 360 : hue;
  };
  const double a1 = (1 + g) * lab1[1], a2 = (1 + g) * lab2[1];
  const double c1 = std::hypot(a1, lab1[2]), c2 = std::hypot(a2, lab2[2]);
  const double h1 = hue_of(a1, lab1[2]), h2 = hue_of(a2, lab2[2]);
  const bool grey = c1 * c2 == 0;
  double hue_step = grey ? 0 : h2 - h1;
  if (hue_step > 180) hue_step -= 360;
  if (hue_step < -180) hue_step += 360;
  const double dl = lab2[0] - lab1[0], dc = c2 - c1;
  const double dh = 2 * std::sqrt(c1 * c2) * std::sin(radians(hue_step / 2));
  const double l = (lab1[0] + lab2[0]) / 2, c = (c1 + c2) / 2;
  double h = h1 + h2;
  if (!grey) {
    if (std::abs(h1 - h2) > 180) h += h < 360 ? 360 : -360;
    h /= 2;
  }
  const double t = 1 - 0.17 * std::cos(radians(h - 30)) + 0.24 * std::cos(radians(2 * h)) +
                   0.32 * std::cos(radians(3 * h + 6)) - 0.20 * std::cos(radians(4 * h - 63));
  const double turn = 30 * std::exp(-std::pow((h - 275) / 25, 2));
  const double rc = 2 * std::sqrt(std::pow(c, 7) / (std::pow(c, 7) + std::pow(25.0, 7)));
  const double sl = 1 + 0.015 * std::pow(l - 50, 2) / std::sqrt(20 + std::pow(l - 50, 2));
  const double sc = 1 + 0.045 * c, sh = 1 + 0.015 * c * t;
  const double rt = -std::sin(radians(2 * turn)) * rc;
  return std::sqrt(std::pow(dl / sl, 2) + std::pow(dc / sc, 2) + std::pow(dh / sh, 2) + rt * (dc / sc) * (dh / sh));
}

}  // namespace lightstage::calib
