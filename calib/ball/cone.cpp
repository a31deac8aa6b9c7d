#include "calib/ball/cone.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <random>

#include "calib/robust/quantile.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

using core::Vec3;

// Any two unit vectors that make a right-handed frame with the unit vector `axis`.
std::pair<Vec3, Vec3> frame_across(Vec3 axis) {
  const Vec3 helper = std::abs(axis.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  const Vec3 across = cross(helper, axis);
  const Vec3 u = across / norm(across);
  return {u, cross(axis, u)};
}

double residual_px(const TangentRay& ray, const Cone& cone) {
  const double angle = std::atan2(norm(cross(ray.ray, cone.axis)), dot(ray.ray, cone.axis));
  return (angle - cone.half_angle) * ray.px_per_radian;
}

// From m = axis / cos(half_angle), of which |m|^2 - 1 = tan^2(half_angle) is given apart, since it loses its
// digits when computed from m for a narrow cone.
std::optional<Cone> cone_from(Vec3 m, double tangent_squared) {
  constexpr double kWidest = 1;  // 45 degrees: points on a line make cones as wide as one likes
  if (!(tangent_squared > 0 && tangent_squared < kWidest)) return std::nullopt;
  return Cone{m / norm(m), std::atan(std::sqrt(tangent_squared))};
}

// Solves r_i . m = 1 for three rays.
std::optional<Cone> cone_through(Vec3 a, Vec3 b, Vec3 c) {
  const double volume = dot(a, cross(b, c));
  if (std::abs(volume) < 1e-14) return std::nullopt;
  const Vec3 m = (cross(b, c) + cross(c, a) + cross(a, b)) / volume;
  return cone_from(m, dot(m, m) - 1);
}

// Solves r_i . m = 1 by weighted least squares. With tangent-plane coordinates u, v of each ray about
// `towards` and m = towards + (p, q, r) in that frame, the equation reads p + q u + r v = sqrt(1 + u^2 + v^2)
// - 1, whose right side is computed without cancellation; u and v are scaled to order 1, so that narrow cones
// are as well conditioned as wide ones.
std::optional<Cone> least_squares_cone(std::span<const TangentRay> rays, std::span<const double> weights,
                                       const Cone& towards) {
  const auto [e1, e2] = frame_across(towards.axis);
  const double scale = std::tan(towards.half_angle);
  const int n = static_cast<int>(rays.size());
  cv::Mat_<double> left(n, 3);
  cv::Mat_<double> right(n, 1);
  for (int i = 0; i < n; ++i) {
    const Vec3 r = rays[std::size_t(i)].ray;
    const double along = dot(r, towards.axis);
    const double u = dot(r, e1) / along;
    const double v = dot(r, e2) / along;
    const double squared = u * u + v * v;
    const double w = std::sqrt(weights[std::size_t(i)]);
    left(i, 0) = w;
    left(i, 1) = w * u / scale;
    left(i, 2) = w * v / scale;
    right(i, 0) = w * squared / (1 + std::sqrt(1 + squared)) / (scale * scale);
  }
  cv::Mat_<double> solution;
  if (!cv::solve(left, right, solution, cv::DECOMP_QR)) return std::nullopt;
  const double p = solution(0, 0) * scale * scale;
  const double q = solution(1, 0) * scale;
  const double r = solution(2, 0) * scale;
  return cone_from((1 + p) * towards.axis + q * e1 + r * e2, p * (2 + p) + q * q + r * r);
}

std::vector<double> residuals_px(std::span<const TangentRay> rays, const Cone& cone) {
  std::vector<double> residuals(rays.size());
  std::transform(rays.begin(), rays.end(), residuals.begin(),
                 [&](const TangentRay& ray) { return residual_px(ray, cone); });
  return residuals;
}

}  // namespace

Cone cone_around(const core::CameraModel& camera, const Sphere& ball) {
  const Vec3 centre = camera.stage_from_camera.inverse().apply(ball.centre);
  const double distance = norm(centre);
  if (!(ball.radius_m > 0) || !(distance > ball.radius_m) || !(centre.z > 0)) {
    throw core::BadInput("calibration ball: it must lie in front of the camera, which must be outside it");
  }
  return {centre / distance, std::asin(ball.radius_m / distance)};
}

Vec3 ball_centre(const core::CameraModel& camera, const Cone& cone, double radius_m) {
  return camera.stage_from_camera.apply(cone.axis * (radius_m / std::sin(cone.half_angle)));
}

Vec3 ray_on_cone(const Cone& cone, double azimuth, double angle) {
  const auto [e1, e2] = frame_across(cone.axis);
  return std::cos(angle) * cone.axis + std::sin(angle) * (std::cos(azimuth) * e1 + std::sin(azimuth) * e2);
}

std::optional<core::Pixel> pixel_on_cone(const core::CameraModel& camera, const Cone& cone, double azimuth,
                                         double angle) {
  return camera.project(camera.stage_from_camera.apply(ray_on_cone(cone, azimuth, angle)));
}

OutlineSigma outline_sigma(const Sphere& ball) {
  constexpr double kIndependentShare = 1.0 / 3;  // neighbouring outline points share pixels
  // However many points there are: what lens blur leaves in the radius is the same all round, and hardly moves the centre. Measured on
  // rendered balls of 20 to 90 pixels' radius.
  constexpr double kCentreBiasPx = 0.005, kRadiusBiasPx = 0.02;
  if (ball.outline_points == 0) return {};
  // The mean of n points on a circle is known to sqrt(2 / n), its radius to sqrt(1 / n) of a point's error.
  const double scatter = ball.outline_rms_px / std::sqrt(kIndependentShare * ball.outline_points);
  return {std::hypot(kCentreBiasPx, std::sqrt(2.0) * scatter), std::hypot(kRadiusBiasPx, scatter)};
}

double outline_radius_px(const core::CameraModel& camera, const Cone& cone) {
  constexpr int kSides = 16;
  double sum = 0;
  for (int i = 0; i < kSides; ++i) {
    const double azimuth = 2 * std::numbers::pi * i / kSides;
    const auto rim = pixel_on_cone(camera, cone, azimuth, cone.half_angle);
    const auto middle = pixel_on_cone(camera, cone, azimuth, 0);
    if (!rim || !middle) throw core::BadInput("calibration ball: it reaches behind the camera");
    sum += std::hypot(rim->x - middle->x, rim->y - middle->y);
  }
  return sum / kSides;
}

std::optional<Cone> consensus_cone(std::span<const TangentRay> rays, double tolerance_px) {
  if (rays.size() < 3) return std::nullopt;
  constexpr int kDraws = 400;   // with half of the rays wrong, all draws fail with probability 1e-23
  std::minstd_rand random(20);  // the sequence is the same on every machine, unlike the standard distributions
  const auto draw = [&] { return rays[random() % rays.size()].ray; };
  std::optional<Cone> best;
  double best_score = 0;
  for (int i = 0; i < kDraws; ++i) {
    const Vec3 a = draw();
    const Vec3 b = draw();
    const Vec3 c = draw();
    const std::optional<Cone> cone = cone_through(a, b, c);
    if (!cone) continue;
    // Near misses count in part, so that among equals the one in the middle of its points wins.
    double score = 0;
    for (const TangentRay& ray : rays) {
      const double share = residual_px(ray, *cone) / tolerance_px;
      score += std::max(0.0, 1 - share * share);
    }
    if (score > best_score) {
      best_score = score;
      best = cone;
    }
  }
  return best;
}

std::optional<ConeFit> fit_cone(std::span<const TangentRay> rays, const Cone& start) {
  if (rays.size() < 3) return std::nullopt;
  constexpr int kIterations = 20;
  constexpr double kSmallestSigmaPx = 0.01;  // below it, residuals are rounding
  Cone cone = start;
  std::vector<double> residuals = residuals_px(rays, cone);
  std::vector<double> weights(rays.size());
  double sigma = 0;
  for (int i = 0; i < kIterations; ++i) {
    sigma = std::max(robust_sigma(residuals), kSmallestSigmaPx);
    // 4.685 sigma: 95 % efficient on normally distributed residuals (Holland and Welsch 1977).
    std::transform(residuals.begin(), residuals.end(), weights.begin(), [&](double r) {
      const double t = r / (4.685 * sigma);
      return std::abs(t) < 1 ? (1 - t * t) * (1 - t * t) : 0.0;
    });
    const std::optional<Cone> next = least_squares_cone(rays, weights, cone);
    if (!next) return std::nullopt;
    const double moved = norm(next->axis - cone.axis) + std::abs(next->half_angle - cone.half_angle);
    cone = *next;
    residuals = residuals_px(rays, cone);
    if (moved < 1e-12) break;
  }
  ConeFit fit{cone};
  double sum = 0;
  for (const double r : residuals) {
    if (std::abs(r) > 3 * sigma) continue;
    sum += r * r;
    ++fit.agreeing;
  }
  fit.rms_px = fit.agreeing > 0 ? std::sqrt(sum / fit.agreeing) : 0;
  return fit;
}

}  // namespace lightstage::calib
