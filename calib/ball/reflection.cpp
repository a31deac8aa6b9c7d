#include <cmath>

#include "calib/light_bundle.h"

namespace lightstage::calib {

using core::Vec3;

std::optional<core::Pixel> predict_highlight(const core::CameraModel& camera, const Sphere& ball, Vec3 light_position) {
  const Vec3 to_viewer = camera.centre() - ball.centre, to_light = light_position - ball.centre;
  const double viewer = norm(to_viewer), light = norm(to_light);
  if (!(viewer > ball.radius_m) || !(light > ball.radius_m)) return std::nullopt;
  const Vec3 a = to_viewer / viewer;
  const double along = dot(a, to_light);
  const Vec3 across = to_light - a * along;
  const double aside = norm(across);
  // Light and viewer in one line: the point between them, or none when the ball hides it.
  if (!(aside > 0)) return along > 0 ? camera.project(ball.centre + a * ball.radius_m) : std::nullopt;
  const Vec3 b = across / aside;
  // In the plane of the three: the viewer at (viewer, 0), the light at (along, aside), the normal at `angle`. The sum of the unit vectors
  // to both turns from one side of the normal to the other as the angle grows.
  const auto turns_on = [&](double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    const double vx = viewer - ball.radius_m * c, vy = -ball.radius_m * s;
    const double lx = along - ball.radius_m * c, ly = aside - ball.radius_m * s;
    const double v = std::hypot(vx, vy), l = std::hypot(lx, ly);
    return (vy / v + ly / l) * c - (vx / v + lx / l) * s > 0;
  };
  double low = 0, high = std::atan2(aside, along);
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (turns_on(middle) ? low : high) = middle;
  }
  const double c = std::cos(low), s = std::sin(low);
  // Beyond the outline as the camera or as the light sees it.
  if (!(viewer * c > ball.radius_m) || !(along * c + aside * s > ball.radius_m)) return std::nullopt;
  return camera.project(ball.centre + (a * c + b * s) * ball.radius_m);
}

}  // namespace lightstage::calib
