#include "sim/subjects/mirror.h"

#include <algorithm>
#include <numbers>

#include "sim/render/sample_grid.h"

namespace lightstage::sim {
namespace {

using core::Vec3;

Vec3 unit(Vec3 v) {
  return v / core::norm(v);
}

// Radiance over the disc relative to its middle, at distance `x` of its radius from there.
double profile(double x) {
  const double edge = std::clamp((1 - x) / 0.2, 0.0, 1.0);
  return edge * edge * (3 - 2 * edge);
}

// A point of the disc's square [-1, 1]^2.
struct Disc {
  explicit Disc(const Lamp& lamp) : lamp_(lamp) {
    const Vec3 axis = unit(lamp.position);
    const Vec3 helper = std::abs(axis.y) < 0.9 ? Vec3{0, 1, 0} : Vec3{1, 0, 0};
    right_ = unit(core::cross(helper, axis)) * lamp.radius;
    up_ = core::cross(axis, right_);
  }
  Vec3 point(double a, double b) const { return lamp_.position + right_ * a + up_ * b; }

 private:
  Lamp lamp_;
  Vec3 right_, up_;
};

// A grid of nodes over a disc's square and where the camera sees each reflected.
class DiscImage {
 public:
  DiscImage(const core::CameraModel& camera, double ball_radius, const Lamp& lamp, int cells) : cells_(cells) {
    const Disc disc(lamp);
    for (int j = 0; j <= cells; ++j) {
      for (int i = 0; i <= cells; ++i) {
        const auto on_ball = reflection_point(ball_radius, camera.centre(), disc.point(coordinate(i), coordinate(j)));
        nodes_.push_back(on_ball ? camera.project(*on_ball) : std::nullopt);
      }
    }
  }

  // Of node i, in [-1, 1].
  double coordinate(int i) const { return 2.0 * i / cells_ - 1; }
  const std::optional<core::Pixel>& node(int i, int j) const { return nodes_[std::size_t(j * (cells_ + 1) + i)]; }

  // The longest side of a cell's image, in pixels.
  double longest_side() const {
    double longest = 0;
    for (int j = 0; j <= cells_; ++j) {
      for (int i = 0; i < cells_; ++i) {
        longest = std::max({longest, distance(node(i, j), node(i + 1, j)), distance(node(j, i), node(j, i + 1))});
      }
    }
    return longest;
  }

 private:
  static double distance(const std::optional<core::Pixel>& a, const std::optional<core::Pixel>& b) {
    return a && b ? std::hypot(a->x - b->x, a->y - b->y) : 0;
  }
  int cells_;
  std::vector<std::optional<core::Pixel>> nodes_;
};

// Spreads `flux` (radiance times area in pixels) over the pixels that see the place.
void splat(core::Image& image, core::Pixel place, const std::array<double, 3>& flux) {
  const int first_x = int(std::ceil(place.x - kFilterReach - 0.5)),
            first_y = int(std::ceil(place.y - kFilterReach - 0.5));
  for (int y = std::max(first_y, 0); y < std::min(first_y + 2 * kFilterReach + 1, image.height()); ++y) {
    const double across = pixel_response(y - place.y);
    for (int x = std::max(first_x, 0); x < std::min(first_x + 2 * kFilterReach + 1, image.width()); ++x) {
      const double weight = across * pixel_response(x - place.x);
      for (std::size_t c = 0; c < 3; ++c) image.pixel(y, x)[c] += float(weight * flux[c]);
    }
  }
}

void add_reflection(core::Image& image, const core::CameraModel& camera, double ball_radius, const Lamp& lamp) {
  // Cells under a tenth of a pixel, where they can be: a lamp straight behind the ball is drawn out to a
  // ring.
  constexpr int kCoarse = 4, kMost = 128;
  constexpr double kCellPixels = 0.1;
  const DiscImage coarse(camera, ball_radius, lamp, kCoarse);
  const double enlarge = coarse.longest_side() / kCellPixels;
  const int cells = std::clamp(int(std::ceil(kCoarse * enlarge)), 12, kMost);
  const DiscImage disc(camera, ball_radius, lamp, cells);

  const double cell_area = 4 * lamp.radius * lamp.radius / (double(cells) * cells);
  double emitting_area = 0;
  const auto strength = [&](int i, int j) {
    const double half = 1.0 / cells;
    return profile(std::hypot(disc.coordinate(i) + half, disc.coordinate(j) + half));
  };
  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) emitting_area += strength(i, j) * cell_area;
  }
  const double squared_distance = core::dot(lamp.position, lamp.position);
  const double radiance = kMirrorReflectance * std::numbers::pi * squared_distance / emitting_area;

  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) {
      const double relative = strength(i, j);
      const auto &a = disc.node(i, j), &b = disc.node(i + 1, j), &c = disc.node(i + 1, j + 1), &d = disc.node(i, j + 1);
      if (relative == 0 || !a || !b || !c || !d) continue;
      // Twice a quadrilateral's area is the cross product of its diagonals.
      const double area = 0.5 * std::abs((c->x - a->x) * (d->y - b->y) - (c->y - a->y) * (d->x - b->x));
      const core::Pixel middle{(a->x + b->x + c->x + d->x) / 4, (a->y + b->y + c->y + d->y) / 4};
      const double flux = radiance * relative * area;
      splat(image, middle, {flux * lamp.gain[0], flux * lamp.gain[1], flux * lamp.gain[2]});
    }
  }
}

}  // namespace

std::optional<Vec3> reflection_point(double ball_radius, Vec3 viewer, Vec3 seen) {
  // All happens in the plane of viewer, centre and light: the normal lies between the directions to both, at
  // the angle where the two rays make equal angles with it. Their tangential parts then cancel; the sum falls
  // along the arc.
  const Vec3 towards = unit(viewer);
  const Vec3 across = seen - towards * core::dot(seen, towards);
  const double offset = core::norm(across);
  const double total = std::atan2(offset, core::dot(seen, towards));
  if (offset == 0) {
    if (total > 0) return std::nullopt;
    return towards * ball_radius;
  }
  const Vec3 sideways = across / offset;
  const auto normal_at = [&](double angle) { return towards * std::cos(angle) + sideways * std::sin(angle); };
  double low = 0, high = total;
  for (int step = 0; step < 60 && high - low > 1e-15; ++step) {
    const double angle = 0.5 * (low + high);
    const Vec3 normal = normal_at(angle);
    const Vec3 tangent = sideways * std::cos(angle) - towards * std::sin(angle);
    const Vec3 point = normal * ball_radius;
    const double balance = core::dot(unit(viewer - point) + unit(seen - point), tangent);
    (balance > 0 ? low : high) = angle;
  }
  const Vec3 normal = normal_at(0.5 * (low + high));
  const Vec3 point = normal * ball_radius;
  if (core::dot(viewer - point, normal) <= 0 || core::dot(seen - point, normal) <= 0) return std::nullopt;
  return point;
}

void add_reflections(core::Image& image, const core::CameraModel& camera, double ball_radius,
                     std::span<const Lamp> lamps) {
  for (const Lamp& lamp : lamps) {
    if (lamp.gain[0] > 0 || lamp.gain[1] > 0 || lamp.gain[2] > 0) add_reflection(image, camera, ball_radius, lamp);
  }
}

}  // namespace lightstage::sim
