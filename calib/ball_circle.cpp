#include "calib/ball_circle.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/ball/cone.h"
#include "core/error.h"

namespace lightstage::calib {

core::CameraModel distant_camera(int width, int height, const Circle& circle) {
  if (!(circle.radius > 0) || !std::isfinite(circle.radius + circle.centre.x + circle.centre.y)) {
    throw core::BadInput("calibration ball: its circle needs a finite centre and a positive radius");
  }
  core::CameraModel camera = core::look_at({0, 0, kFarInRadii}, {0, 0, 0}, width, height, 1);
  camera.fx = camera.fy = circle.radius * kFarInRadii;
  camera.cx = circle.centre.x;
  camera.cy = circle.centre.y;
  return camera;
}

Sphere ball_in_circle(const core::CameraModel& camera, const Circle& circle, double radius_m, double sigma_px) {
  constexpr int kPoints = 64;
  constexpr int kHandDrawnPoints = 3;  // a circle given as a whole is as good as three points of that error
  std::vector<TangentRay> rays;
  for (int i = 0; i < kPoints; ++i) {
    const double azimuth = 2 * std::numbers::pi * i / kPoints;
    const core::Pixel p{circle.centre.x + circle.radius * std::cos(azimuth),
                        circle.centre.y + circle.radius * std::sin(azimuth)};
    rays.push_back({camera.ray_in_camera(p), 0.5 * (camera.fx + camera.fy)});
  }
  const std::optional<Cone> start = consensus_cone(rays, circle.radius);
  const std::optional<ConeFit> fit = start ? fit_cone(rays, *start) : std::nullopt;
  if (!fit || !(radius_m > 0)) throw core::BadInput("calibration ball: no ball's image fills the circle");
  return {ball_centre(camera, fit->cone, radius_m), radius_m, sigma_px, kHandDrawnPoints};
}

FoundCircle locate_circle(core::ImageView picture) {
  const Circle guess{{0.5 * (picture.width() - 1), 0.5 * (picture.height() - 1)},
                     std::max(1.0, std::min(picture.width(), picture.height()) / 3.0)};
  const core::CameraModel camera = distant_camera(picture.width(), picture.height(), guess);
  const Sphere ball = locate_sphere(picture, camera, 1);
  const std::optional<core::Pixel> centre = camera.project(ball.centre);
  if (!centre) throw core::BadInput("calibration ball: no circle found");
  const double distance = norm(ball.centre - camera.centre());
  return {{*centre, guess.radius * kFarInRadii / distance}, ball.outline_rms_px, ball.outline_points};
}

std::vector<core::Pixel> outline_pixels(const core::CameraModel& camera, const Sphere& ball) {
  constexpr int kSides = 256;
  const Cone cone = cone_around(camera, ball);
  std::vector<core::Pixel> pixels;
  for (int i = 0; i < kSides; ++i) {
    const auto p = pixel_on_cone(camera, cone, 2 * std::numbers::pi * i / kSides, cone.half_angle);
    if (!p) return {};
    pixels.push_back(*p);
  }
  return pixels;
}

}  // namespace lightstage::calib
