#include "calib/shading.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "calib/ball/cone.h"
#include "calib/ball/grey_ball.h"
#include "calib/ball/hit.h"
#include "calib/robust/quantile.h"
#include "calib/spot/ball_region.h"
#include "core/direction.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

using core::Vec3;

constexpr double kFloorOfVariance = 0.05;  // of read noise next to shot noise, on the scale of the brightest prediction

// Unknowns: the channels' factors, then the two turns times the channel's factor of 1.
constexpr int kUnknowns = 5;

struct Row {
  std::array<double, kUnknowns> by{};
  double seen = 0;
  double weight = 0;
};

struct Tangents {
  Vec3 u, v;
};

Tangents across(Vec3 axis) {
  const Vec3 helper = std::abs(axis.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  const Vec3 aside = cross(helper, axis);
  const Vec3 u = aside / norm(aside);
  return {u, cross(axis, u)};
}

struct Solution {
  Eigen::Matrix<double, kUnknowns, 1> x;
  Eigen::Matrix<double, kUnknowns, kUnknowns> covariance;
};

// Reweighted to leave out what is four robust standard deviations off.
std::optional<Solution> solve(const std::vector<Row>& rows) {
  using Vector = Eigen::Matrix<double, kUnknowns, 1>;
  using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  constexpr int kRounds = 3;
  std::vector<char> used(rows.size(), 1);
  std::vector<double> residuals(rows.size());
  Solution solution;
  for (int round = 0; round < kRounds; ++round) {
    Matrix left = Matrix::Zero();
    Vector right = Vector::Zero();
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (used[i] == 0) continue;
      const Eigen::Map<const Vector> by(rows[i].by.data());
      left += rows[i].weight * by * by.transpose();
      right += rows[i].weight * rows[i].seen * by;
    }
    const Eigen::LDLT<Matrix> factors(left);
    if (factors.info() != Eigen::Success || !factors.isPositive()) return std::nullopt;
    solution.x = factors.solve(right);
    double squares = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Eigen::Map<const Vector> by(rows[i].by.data());
      residuals[i] = (rows[i].seen - by.dot(solution.x)) * std::sqrt(rows[i].weight);
      if (used[i] == 0) continue;
      squares += residuals[i] * residuals[i];
      ++count;
    }
    solution.covariance =
        factors.solve(Matrix::Identity()) * (squares / double(std::max<std::size_t>(1, count - kUnknowns)));
    const double limit = 4 * robust_sigma(residuals);
    for (std::size_t i = 0; i < rows.size(); ++i) used[i] = std::abs(residuals[i]) <= limit;
  }
  return solution;
}

}  // namespace

ShadingResidual compare_shading(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                double albedo, const KnownLight& light, double saturation) {
  if (!(albedo > 0) || !std::isfinite(albedo)) throw core::BadInput("grey ball: its albedo must be positive");
  require_picture_of(picture, camera, "grey ball");
  const int channels = picture.channels();
  if (channels != 1 && channels != 3) throw core::BadInput("grey ball: the picture must have 1 or 3 channels");
  const double stage_distance = norm(light.position);
  if (!(norm(light.position - ball.centre) > ball.radius_m)) {
    throw core::BadInput("grey ball: the light lies inside the ball");
  }
  ShadingResidual result;
  // Grey pictures see the mean of the gains.
  std::array<double, 3> gain = light.gain;
  if (channels == 1) gain[0] = (gain[0] + gain[1] + gain[2]) / 3;
  if (!std::all_of(gain.begin(), gain.begin() + channels, [](double g) { return g > 0; })) {
    result.reason = "the calibration has no light from it";
    return result;
  }
  const Cone cone = cone_around(camera, ball);
  const double radius_px = outline_radius_px(camera, cone);
  const auto middle = pixel_on_cone(camera, cone, 0, 0);
  const double margin = kRimPx / radius_px;
  const double reach = 1.2 * radius_px + 2;
  const int top = std::clamp(static_cast<int>(middle->y - reach), 0, picture.height());
  const int bottom = std::clamp(static_cast<int>(middle->y + reach) + 1, 0, picture.height());
  const int left = std::clamp(static_cast<int>(middle->x - reach), 0, picture.width());
  const int right = std::clamp(static_cast<int>(middle->x + reach) + 1, 0, picture.width());
  const auto [u, v] = across(light.position / stage_distance);
  std::vector<Row> rows;
  double predicted_squares = 0, off_squares = 0;
  for (int y = top; y < bottom; ++y) {
    for (int x = left; x < right; ++x) {
      const float* pixel = picture.pixel(y, x);
      if (saturation > 0 &&
          std::any_of(pixel, pixel + channels, [&](float value) { return value >= kClippedShare * saturation; })) {
        continue;
      }
      const std::optional<BallHit> hit = hit_ball(camera, ball, {double(x), double(y)});
      if (!hit || hit->miss > 1 - margin) continue;
      const Vec3 to_light = light.position - (ball.centre + hit->normal * ball.radius_m);
      const double distance = norm(to_light);
      const double cosine = dot(hit->normal, to_light) / distance;
      if (cosine < kLeastCosine) continue;
      const double falloff = albedo * stage_distance * stage_distance / (distance * distance);
      for (int c = 0; c < channels; ++c) {
        const double strength = falloff * gain[std::size_t(c)];
        Row row;
        row.by[std::size_t(c)] = strength * cosine;
        // A light that turns by an angle about stage centre moves by so much over its distance as seen from the surface.
        row.by[3] = strength * dot(hit->normal, u) * stage_distance / distance;
        row.by[4] = strength * dot(hit->normal, v) * stage_distance / distance;
        row.seen = pixel[c];
        row.weight = 1 / (row.by[std::size_t(c)] + kFloorOfVariance * albedo * gain[std::size_t(c)]);
        predicted_squares += row.by[std::size_t(c)] * row.by[std::size_t(c)];
        off_squares += std::pow(row.seen - row.by[std::size_t(c)], 2);
        rows.push_back(row);
      }
    }
  }
  if (rows.size() < std::size_t(kLeastPixels * channels)) {
    result.reason = "only " + std::to_string(rows.size() / std::size_t(channels)) +
                    " pixels of the ball are lit, seen and not clipped";
    return result;
  }
  if (channels == 1) {
    // Two factors that nothing depends on.
    for (std::size_t c : {1, 2}) {
      Row row;
      row.by[c] = 1;
      row.seen = 1;
      row.weight = 1;
      rows.push_back(row);
    }
  }
  const std::optional<Solution> found = solve(rows);
  if (!found) {
    result.reason = "the lit part of the ball does not tell where the light is";
    return result;
  }
  result.compared = true;
  double mean_ratio = 0;
  for (int c = 0; c < channels; ++c) {
    result.gain_ratio[std::size_t(c)] = found->x[c];
    mean_ratio += found->x[c] / channels;
    result.gain_sigma += found->covariance(c, c) / channels;
  }
  if (channels == 1) result.gain_ratio = {found->x[0], found->x[0], found->x[0]};
  const double ratio_sigma = std::sqrt(result.gain_sigma);
  constexpr double kDarkSigmas = 5;
  if (!(mean_ratio > kDarkSigmas * ratio_sigma)) {
    result.gain_ratio = {0, 0, 0};
    result.gain_sigma = ratio_sigma;
    result.degrees_sigma = 180;
    result.residual = 1;
    return result;
  }
  result.gain_sigma = ratio_sigma / mean_ratio;
  const OutlineSigma outline = outline_sigma(ball);
  const double turned = std::hypot(found->x[3], found->x[4]) / mean_ratio;
  const double scatter = std::sqrt(found->covariance(3, 3) + found->covariance(4, 4)) / mean_ratio;
  const double normals = std::sqrt(2.0) * outline.centre_px / radius_px;
  result.degrees = core::degrees_from_radians(turned);
  result.degrees_sigma = core::degrees_from_radians(std::hypot(scatter, normals));
  result.residual = std::sqrt(off_squares / predicted_squares);
  return result;
}

}  // namespace lightstage::calib
