#include "calib/ball_pictures.h"

#include <numbers>
#include <random>

#include "calib/mirror_ball.h"
#include "core/direction.h"
#include "core/sphere.h"

namespace lightstage::test {

using core::Vec3;

namespace {

Vec3 unit(Vec3 v) {
  return v / norm(v);
}

// Where on the ball `viewer` sees `seen` reflected, by halving the angle between the two (Alhazen's problem).
std::optional<Vec3> reflection_point(Vec3 centre, double radius, Vec3 viewer, Vec3 seen) {
  const Vec3 a = unit(viewer - centre);
  const Vec3 to_seen = seen - centre;
  const Vec3 rest = to_seen - a * dot(a, to_seen);
  const Vec3 b = unit(rest);
  double low = 0, high = std::atan2(norm(rest), dot(a, to_seen));
  for (int i = 0; i < 60; ++i) {
    const double angle = 0.5 * (low + high);
    const Vec3 normal = a * std::cos(angle) + b * std::sin(angle);
    const Vec3 tangent = b * std::cos(angle) - a * std::sin(angle);
    const Vec3 p = centre + normal * radius;
    (dot(unit(viewer - p) + unit(seen - p), tangent) > 0 ? low : high) = angle;
  }
  const Vec3 normal = a * std::cos(low) + b * std::sin(low);
  const Vec3 p = centre + normal * radius;
  if (dot(viewer - p, normal) <= 0) return std::nullopt;
  return p;
}

// Share of a point's light, blurred by a Gaussian, that falls into a pixel `offset` away, on one axis.
double pixel_share(double offset, double blur_px) {
  const double s = 1 / (blur_px * std::numbers::sqrt2);
  return 0.5 * (std::erf((offset + 0.5) * s) - std::erf((offset - 0.5) * s));
}

void splat(core::Image& image, core::Pixel at, double flux, double blur_px) {
  const int reach = static_cast<int>(std::ceil(6 * blur_px + 1));
  const int cx = static_cast<int>(std::lround(at.x)), cy = static_cast<int>(std::lround(at.y));
  for (int y = std::max(0, cy - reach); y <= std::min(image.height() - 1, cy + reach); ++y) {
    for (int x = std::max(0, cx - reach); x <= std::min(image.width() - 1, cx + reach); ++x) {
      image(y, x) += float(flux * pixel_share(x - at.x, blur_px) * pixel_share(y - at.y, blur_px));
    }
  }
}

core::Image blurred(const core::Image& sharp, double blur_px) {
  const int reach = static_cast<int>(std::ceil(4 * blur_px));
  std::vector<double> kernel;
  double total = 0;
  for (int k = -reach; k <= reach; ++k) {
    kernel.push_back(std::exp(-0.5 * k * k / (blur_px * blur_px)));
    total += kernel.back();
  }
  const auto pass = [&](const core::Image& from, bool across) {
    core::Image to(from.height(), from.width(), 1);
    for (int y = 0; y < from.height(); ++y) {
      for (int x = 0; x < from.width(); ++x) {
        double value = 0;
        for (int k = -reach; k <= reach; ++k) {
          const int yy = std::clamp(across ? y : y + k, 0, from.height() - 1);
          const int xx = std::clamp(across ? x + k : x, 0, from.width() - 1);
          value += kernel[std::size_t(k + reach)] / total * double(from(yy, xx));
        }
        to(y, x) = float(value);
      }
    }
    return to;
  };
  return pass(pass(sharp, true), false);
}

}  // namespace

core::CameraModel stage_camera(int pixels) {
  const double distance = 1.9;
  core::CameraModel camera = core::look_at({0, 0, distance}, {0, 0, 0}, pixels, pixels,
                                           core::degrees_from_radians(2 * std::atan(1.0 / 6 / distance)));
  camera.k1 = -0.08;
  return camera;
}

std::vector<Lamp> stage_lamps(std::size_t n, double radius_m, double error_degrees, std::uint64_t seed) {
  std::vector<Lamp> lamps;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, core::radians_from_degrees(error_degrees));
  for (const core::Direction& d : core::fibonacci_directions(n)) {
    const Vec3 moved = d.vec() + Vec3{normal(random), normal(random), normal(random)};
    lamps.push_back({unit(moved) * radius_m});
  }
  return lamps;
}

core::Image mirror_reflections(const core::CameraModel& camera, const calib::Sphere& ball,
                               const std::vector<Lamp>& lamps, double blur_px) {
  core::Image image(camera.height, camera.width, 1);
  constexpr int kCells = 12;
  for (const Lamp& lamp : lamps) {
    const Vec3 axis = unit(lamp.position);
    const Vec3 u = unit(cross(std::abs(axis.y) < 0.9 ? Vec3{0, 1, 0} : Vec3{1, 0, 0}, axis));
    const Vec3 v = cross(axis, u);
    // Irradiance pi gain at stage centre from a facing disc: radiance = gain (distance / radius)^2.
    const double radiance = 0.9 * lamp.gain * dot(lamp.position, lamp.position) / (lamp.radius_m * lamp.radius_m);
    const double cell = 2 * lamp.radius_m / kCells;
    for (int j = 0; j < kCells; ++j) {
      for (int i = 0; i < kCells; ++i) {
        const double a = (i + 0.5) * cell - lamp.radius_m, b = (j + 0.5) * cell - lamp.radius_m;
        if (std::hypot(a, b) > lamp.radius_m) continue;
        const auto seen = [&](double s, double t) -> std::optional<core::Pixel> {
          const auto p = reflection_point(ball.centre, ball.radius_m, camera.centre(), lamp.position + u * s + v * t);
          return p ? camera.project(*p) : std::nullopt;
        };
        // The cell's area in the picture from two sides of it.
        const auto here = seen(a, b), right = seen(a + 0.5 * cell, b), left = seen(a - 0.5 * cell, b),
                   up = seen(a, b + 0.5 * cell), down = seen(a, b - 0.5 * cell);
        if (!here || !right || !left || !up || !down) continue;
        const double area =
            std::abs((right->x - left->x) * (up->y - down->y) - (right->y - left->y) * (up->x - down->x));
        splat(image, *here, radiance * area, blur_px);
      }
    }
  }
  return image;
}

core::Image lambertian_ball(const core::CameraModel& camera, const calib::Sphere& ball, const std::vector<Lamp>& lamps,
                            double albedo, double blur_px) {
  constexpr int kSide = 3;
  core::Image image(camera.height, camera.width, 1);
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      double value = 0;
      for (int s = 0; s < kSide * kSide; ++s) {
        const core::Pixel p{x + (s % kSide + 0.5) / kSide - 0.5, y + (s / kSide + 0.5) / kSide - 0.5};
        const Vec3 view = camera.ray(p);
        const Vec3 from = camera.centre() - ball.centre;
        const double b = dot(from, view), c = dot(from, from) - ball.radius_m * ball.radius_m;
        if (b * b < c) continue;
        const Vec3 point = camera.centre() + view * (-b - std::sqrt(b * b - c));
        const Vec3 normal = (point - ball.centre) / ball.radius_m;
        for (const Lamp& lamp : lamps) {
          const Vec3 to = lamp.position - point;
          const double d2 = dot(to, to);
          value += lamp.gain * std::max(0.0, dot(to, normal) / std::sqrt(d2)) * dot(lamp.position, lamp.position) / d2;
        }
      }
      image(y, x) = float(albedo * value / (kSide * kSide));
    }
  }
  return blurred(image, blur_px);
}

core::Image sum(const core::Image& a, const core::Image& b, float factor_b) {
  core::Image result = a;
  for (std::size_t i = 0; i < result.values().size(); ++i) result.values()[i] += factor_b * b.values()[i];
  return result;
}

core::Image through_sensor(const core::Image& radiance, double exposure, std::uint64_t seed) {
  constexpr double kFullWell = 12000, kReadNoise = 6, kCodes = 4095;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, 1);
  core::Image result = radiance;
  for (float& v : result.values()) {
    const double electrons = std::min(double(v) * exposure, 2.0) * kFullWell;
    const double noisy = (electrons + normal(random) * std::sqrt(electrons + kReadNoise * kReadNoise)) / kFullWell;
    // The black level lies well above 0, so that negative noise is kept.
    v = float(std::round(std::min(noisy, 1.0) * kCodes) / kCodes / exposure);
  }
  return result;
}

double degrees_between(Vec3 a, Vec3 b) {
  return core::degrees_from_radians(
      core::angle_radians(core::Direction::from_vector(a), core::Direction::from_vector(b)));
}

double percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[std::size_t(std::lround(share * double(values.size() - 1)))];
}
double median(std::vector<double> values) {
  return percentile(std::move(values), 0.5);
}

}  // namespace lightstage::test
