#include "model/flip.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "core/display.h"
#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::model {

namespace {

// Section numbers are those of the publication.
using Triple = std::array<double, 3>;

template <class Function>
void each_pixel(core::ImageSize size, const Function& function) {
  core::parallel_for(std::size_t(size.height), 8, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y)
      for (int x = 0; x < size.width; ++x) function(int(y), x);
  });
}

// IEC 61966-2-1: linear sRGB to XYZ. White is the sum of its columns, so that greys are exactly neutral.
constexpr double kXyzOfRgb[3][3] = {{506752.0 / 1228815, 87881.0 / 245763, 12673.0 / 70218},
                                    {87098.0 / 409605, 175762.0 / 245763, 12673.0 / 175545},
                                    {7918.0 / 409605, 87881.0 / 737289, 1001167.0 / 1053270}};

const Triple& white() {
  static const Triple value = [] {
    Triple sums{};
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) sums[std::size_t(i)] += kXyzOfRgb[i][j];
    return sums;
  }();
  return value;
}

// XYZ relative to white.
Triple relative_xyz(const Triple& rgb) {
  Triple result{};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) result[std::size_t(i)] += kXyzOfRgb[i][j] * rgb[std::size_t(j)];
    result[std::size_t(i)] /= white()[std::size_t(i)];
  }
  return result;
}

const cv::Matx33d& rgb_of_xyz() {
  static const cv::Matx33d value = cv::Matx33d(&kXyzOfRgb[0][0]).inv();
  return value;
}

// Section 4.1.1: the opponent space in which filters act, linear in RGB.
Triple opponent(const Triple& rgb) {
  const Triple v = relative_xyz(rgb);
  return {116 * v[1] - 16, 500 * (v[0] - v[1]), 200 * (v[1] - v[2])};
}

Triple rgb_of_opponent(const Triple& yxz) {
  const double y = (yxz[0] + 16) / 116;
  const cv::Vec3d xyz(white()[0] * (y + yxz[1] / 500), white()[1] * y, white()[2] * (y - yxz[2] / 200));
  const cv::Vec3d rgb = rgb_of_xyz() * xyz;
  return {rgb[0], rgb[1], rgb[2]};
}

// Section 4.1.2: CIELAB with the Hunt effect, colours count less in the dark.
Triple hunt_lab(const Triple& rgb) {
  const auto f = [](double t) {
    constexpr double kDelta = 6.0 / 29;
    return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
  };
  const Triple v = relative_xyz(rgb);
  const double x = f(v[0]), y = f(v[1]), z = f(v[2]), lightness = 116 * y - 16;
  return {lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)};
}

// Section 4.1.3: HyAB distance to the power q_c, and its range mapped to [0, 1], the largest of it compressed.
double colour_distance(const Triple& a, const Triple& b) {
  return std::pow(std::abs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]), 0.7);
}

double colour_difference(const Triple& a, const Triple& b) {
  static const double largest = colour_distance(hunt_lab({0, 1, 0}), hunt_lab({0, 0, 1}));
  constexpr double kKnee = 0.4, kKneeValue = 0.95;
  const double distance = colour_distance(a, b) / largest;
  if (distance < kKnee) return distance / kKnee * kKneeValue;
  return std::min(1.0, kKneeValue + (distance - kKnee) / (1 - kKnee) * (1 - kKneeValue));
}

cv::Mat filtered(const cv::Mat& plane, const std::vector<double>& along_x, const std::vector<double>& along_y) {
  cv::Mat result;
  cv::sepFilter2D(plane, result, CV_64F, along_x, along_y, cv::Point(-1, -1), 0, cv::BORDER_REPLICATE);
  return result;
}

// exp(-x^2 / (2 sigma^2)) for x = -radius .. radius; sigma and x in pixels.
std::vector<double> gaussian(double sigma, int radius) {
  std::vector<double> values;
  for (int x = -radius; x <= radius; ++x) values.push_back(std::exp(-double(x) * x / (2 * sigma * sigma)));
  return values;
}

double sum(const std::vector<double>& values) {
  double result = 0;
  for (const double v : values) result += v;
  return result;
}

void scale(std::vector<double>& values, double factor) {
  for (double& v : values) v *= factor;
}

// Section 4.1.1: a contrast sensitivity as the sum of two Gaussians a sqrt(pi/b) exp(-pi^2 d^2 / b), d in degrees, of unit sum as a whole.
struct Sensitivity {
  double a1, b1, a2, b2;
};
constexpr std::array<Sensitivity, 3> kSensitivity{
    {{1, 0.0047, 0, 1e-5}, {1, 0.0053, 0, 1e-5}, {34.1, 0.04, 13.5, 0.025}}};

cv::Mat seen(const cv::Mat& plane, const Sensitivity& sensitivity, double pixels_per_degree) {
  constexpr double kWidest = 0.04;  // of all b above
  constexpr double kPi = std::numbers::pi;
  const int radius = int(std::ceil(3 * std::sqrt(kWidest / (2 * kPi * kPi)) * pixels_per_degree));
  cv::Mat result = cv::Mat::zeros(plane.size(), CV_64F);
  double total = 0;
  for (const auto& [a, b] : {std::pair(sensitivity.a1, sensitivity.b1), std::pair(sensitivity.a2, sensitivity.b2)}) {
    if (a == 0) continue;
    std::vector<double> line = gaussian(std::sqrt(b / 2) / kPi * pixels_per_degree, radius);
    const double whole = sum(line), share = a * std::sqrt(kPi / b) * whole * whole;
    scale(line, 1 / whole);
    result += share * filtered(plane, line, line);
    total += share;
  }
  return result / total;
}

// Section 4.2: how much of an edge and of a point there is at a pixel, from first and second derivatives of a Gaussian along both axes,
// each scaled so that its positive and its negative values have unit sum.
struct Features {
  cv::Mat edge, point;
};

void scale_signs(std::vector<double>& line) {
  double positive = 0, negative = 0;
  for (const double v : line) (v > 0 ? positive : negative) += v;
  for (double& v : line) v /= v > 0 ? positive : -negative;
}

Features features(const cv::Mat& luminance, double pixels_per_degree) {
  constexpr double kWidthDegrees = 0.082;
  const double sigma = 0.5 * kWidthDegrees * pixels_per_degree;
  const int radius = int(std::ceil(3 * sigma));
  std::vector<double> smooth = gaussian(sigma, radius), first = smooth, second = smooth;
  for (int x = -radius; x <= radius; ++x) {
    first[std::size_t(x + radius)] *= -x;
    second[std::size_t(x + radius)] *= x * x / (sigma * sigma) - 1;
  }
  scale(smooth, 1 / sum(smooth));
  scale_signs(first);
  scale_signs(second);
  Features result;
  cv::magnitude(filtered(luminance, first, smooth), filtered(luminance, smooth, first), result.edge);
  cv::magnitude(filtered(luminance, second, smooth), filtered(luminance, smooth, second), result.point);
  return result;
}

// One picture as the observer sees it.
struct Seen {
  std::array<cv::Mat, 3> opponent;  // filtered by the eye
  Features features;

  Seen(core::ImageView picture, double pixels_per_degree) {
    for (cv::Mat& plane : opponent) plane.create(picture.height(), picture.width(), CV_64F);
    each_pixel(picture.size(), [&](int y, int x) {
      Triple rgb{};
      for (int c = 0; c < 3; ++c) {
        const float value = picture(y, x, picture.channels() == 1 ? 0 : c);
        rgb[std::size_t(c)] = double(core::display_decode(std::clamp(value, 0.0f, 1.0f)));
      }
      const Triple values = model::opponent(rgb);
      for (std::size_t c = 0; c < 3; ++c) opponent[c].at<double>(y, x) = values[c];
    });
    features = model::features((opponent[0] + 16) / 116, pixels_per_degree);
    for (std::size_t c = 0; c < 3; ++c) opponent[c] = seen(opponent[c], kSensitivity[c], pixels_per_degree);
  }

  Triple colour(int y, int x) const {
    Triple rgb =
        rgb_of_opponent({opponent[0].at<double>(y, x), opponent[1].at<double>(y, x), opponent[2].at<double>(y, x)});
    for (double& v : rgb) v = std::clamp(v, 0.0, 1.0);
    return hunt_lab(rgb);
  }
};

double feature_difference(const Features& a, const Features& b, int y, int x) {
  const double edges = std::abs(a.edge.at<double>(y, x) - b.edge.at<double>(y, x));
  const double points = std::abs(a.point.at<double>(y, x) - b.point.at<double>(y, x));
  return std::min(1.0, std::sqrt(std::max(edges, points) / std::numbers::sqrt2));
}

}  // namespace

core::Image flip_map(core::ImageView a, core::ImageView b, double pixels_per_degree) {
  if (a.size() != b.size()) throw core::BadInput("pictures of different sizes cannot be compared");
  if (a.channels() != 1 && a.channels() != 3)
    throw core::BadInput("FLIP compares pictures of one channel or three, not of " + std::to_string(a.channels()));
  if (!(pixels_per_degree >= 1 && pixels_per_degree <= 1000))
    throw core::BadInput("FLIP takes 1 to 1000 pixels a degree, not " + std::to_string(pixels_per_degree));
  const Seen first(a, pixels_per_degree), second(b, pixels_per_degree);
  core::Image map(a.height(), a.width(), 1);
  each_pixel(a.size(), [&](int y, int x) {
    // Section 4.3: features that differ make a difference of colour more visible.
    const double colour = colour_difference(first.colour(y, x), second.colour(y, x));
    map(y, x) = float(std::pow(colour, 1 - feature_difference(first.features, second.features, y, x)));
  });
  return map;
}

}  // namespace lightstage::model
