#include "core/camera_model.h"

#include <algorithm>
#include <cmath>

#include "core/direction.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::core {

namespace {

// A point of the normalised image plane (z = 1).
struct PlanePoint {
  double x, y;
};

struct Distorted {
  PlanePoint at;
  double dx_dx, dx_dy, dy_dx, dy_dy;  // its Jacobian
};

// Brown 1971, "Close-range camera calibration", in OpenCV's order of coefficients:
// x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2),  y' with x, y and p1, p2 exchanged.
Distorted distort(const CameraModel& camera, PlanePoint p) {
  const double r2 = p.x * p.x + p.y * p.y;
  const double radial = 1 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3));
  const double radial_slope = camera.k1 + r2 * (2 * camera.k2 + r2 * 3 * camera.k3);  // d radial / d r^2
  Distorted d{};
  d.at.x = p.x * radial + 2 * camera.p1 * p.x * p.y + camera.p2 * (r2 + 2 * p.x * p.x);
  d.at.y = p.y * radial + 2 * camera.p2 * p.x * p.y + camera.p1 * (r2 + 2 * p.y * p.y);
  d.dx_dx = radial + 2 * p.x * p.x * radial_slope + 2 * camera.p1 * p.y + 6 * camera.p2 * p.x;
  d.dx_dy = 2 * p.x * p.y * radial_slope + 2 * camera.p1 * p.x + 2 * camera.p2 * p.y;
  d.dy_dx = d.dx_dy;
  d.dy_dy = radial + 2 * p.y * p.y * radial_slope + 2 * camera.p2 * p.x + 6 * camera.p1 * p.y;
  return d;
}

constexpr double kInverseTolerance = 1e-12;
constexpr int kMaxNewtonSteps = 50;

// Newton's method on distort(p) = target, each step halved until the residual falls, so that it does not
// leave the region around the optical axis in which the distortion is one to one.
std::optional<PlanePoint> undistort(const CameraModel& camera, PlanePoint target) {
  const auto residual = [&](const Distorted& d) { return std::hypot(d.at.x - target.x, d.at.y - target.y); };
  const double tolerance = kInverseTolerance * std::max(1.0, std::hypot(target.x, target.y));
  PlanePoint p = target;
  Distorted d = distort(camera, p);
  if (!(d.dx_dx * d.dy_dy - d.dx_dy * d.dy_dx > 0)) {
    p = {0, 0};
    d = distort(camera, p);
  }
  for (int step = 0; step < kMaxNewtonSteps; ++step) {
    const double error = residual(d);
    if (error <= tolerance) return p;
    const double determinant = d.dx_dx * d.dy_dy - d.dx_dy * d.dy_dx;
    if (!(determinant > 0)) return std::nullopt;  // beyond the fold of the distortion
    const double ex = d.at.x - target.x, ey = d.at.y - target.y;
    const double sx = (d.dy_dy * ex - d.dx_dy * ey) / determinant;
    const double sy = (d.dx_dx * ey - d.dy_dx * ex) / determinant;
    double length = 1;
    PlanePoint next{};
    Distorted next_d{};
    do {
      next = {p.x - length * sx, p.y - length * sy};
      next_d = distort(camera, next);
      length /= 2;
    } while (!(residual(next_d) < error) && length > 1e-6);
    if (!(residual(next_d) < error)) return std::nullopt;
    p = next;
    d = next_d;
  }
  return std::nullopt;
}

}  // namespace

std::optional<Pixel> CameraModel::project(Vec3 stage_point) const {
  const Vec3 p = stage_from_camera.inverse().apply(stage_point);
  if (!(p.z > 0)) return std::nullopt;
  const PlanePoint q = distort(*this, {p.x / p.z, p.y / p.z}).at;
  return Pixel{fx * q.x + cx, fy * q.y + cy};
}

Vec3 CameraModel::ray_in_camera(Pixel pixel) const {
  const std::optional<PlanePoint> p = undistort(*this, {(pixel.x - cx) / fx, (pixel.y - cy) / fy});
  if (!p)
    throw BadInput("the camera's distortion cannot be inverted at pixel (" + number_text(pixel.x) + ", " +
                   number_text(pixel.y) + "); its coefficients do not describe a lens there");
  return Direction::from_vector({p->x, p->y, 1}).vec();
}

Vec3 CameraModel::ray(Pixel pixel) const {
  return stage_from_camera.rotation * ray_in_camera(pixel);
}

CameraModel look_at(Vec3 position, Vec3 target, int width, int height, double field_of_view_degrees) {
  if (width <= 0 || height <= 0) throw BadInput("a camera needs a positive image size");
  if (!(field_of_view_degrees > 0 && field_of_view_degrees < 180))
    throw BadInput("a camera's field of view must lie between 0 and 180 degrees, not " +
                   number_text(field_of_view_degrees));
  if (target == position) throw BadInput("a camera cannot look at its own position");
  const Vec3 forward = Direction::from_vector(target - position).vec();
  const Vec3 across = cross(forward, {0, 1, 0});
  if (norm(across) < 1e-9) throw BadInput("a camera that looks along the stage's y axis has no 'up'");
  const Vec3 right = Direction::from_vector(across).vec();
  CameraModel camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = width / 2.0 / std::tan(radians_from_degrees(field_of_view_degrees) / 2);
  camera.cx = (width - 1) / 2.0;
  camera.cy = (height - 1) / 2.0;
  camera.stage_from_camera.rotation = Mat3{{right, cross(forward, right), forward}}.transposed();
  camera.stage_from_camera.translation = position;
  return camera;
}

}  // namespace lightstage::core
