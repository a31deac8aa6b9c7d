#include "relight/small_sources.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "core/parallel.h"

namespace lightstage::relight {

namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kSurroundRadius = 7 * kPi / 180;
constexpr double kContrast = 2;
constexpr int kWidth = 256, kHeight = 128;

double brightness(const Environment& map, int y, int x) {
  const float* p = map.radiance().pixel(y, x);
  return double(p[0]) + double(p[1]) + double(p[2]);
}

// A map's surround, and which pixels stand out of it.
class Surround {
 public:
  explicit Surround(const Environment& map)
      : map_(map), medians_(std::size_t(map.height()) * std::size_t(map.width())) {
    core::parallel_for(std::size_t(map.height()), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t y = first; y < last; ++y) fill_row(int(y));
    });
  }

  double excess(double brightness, int y, int x) const {
    return std::max(0.0, brightness - kContrast * medians_[index(y, x)]);
  }
  double excess(int y, int x) const { return excess(brightness(map_, y, x), y, x); }
  std::size_t index(int y, int x) const { return std::size_t(y) * std::size_t(map_.width()) + std::size_t(x); }

 private:
  struct Value {
    double brightness, solid_angle;
  };

  double latitude(int y) const { return kPi * (0.5 - (y + 0.5) / map_.height()); }

  // How many columns to either side the disc about a pixel of row y reaches in row `other`; -1 where it does not.
  int reach(int y, int other) const {
    const double a = latitude(y), b = latitude(other);
    const double cosine = (std::cos(kSurroundRadius) - std::sin(a) * std::sin(b)) / (std::cos(a) * std::cos(b));
    if (cosine > 1) return y == other ? 0 : -1;  // at least the pixel itself
    return int(std::acos(std::max(cosine, -1.0)) / (2 * kPi) * map_.width());
  }

  void fill_row(int y) {
    const int width = map_.width();
    std::vector<Value> disc;
    const int rows = int(kSurroundRadius / kPi * map_.height()) + 1;
    for (int x = 0; x < width; ++x) {
      disc.clear();
      for (int other = std::max(0, y - rows); other <= std::min(map_.height() - 1, y + rows); ++other) {
        const int columns = reach(y, other);
        const int count = std::min(2 * columns + 1, width);
        for (int i = 0; i < count; ++i)
          disc.push_back(
              {brightness(map_, other, ((x - columns + i) % width + width) % width), map_.solid_angle(other)});
      }
      medians_[index(y, x)] = median(disc);
    }
  }

  static double median(std::vector<Value>& values) {
    std::sort(values.begin(), values.end(), [](const Value& a, const Value& b) { return a.brightness < b.brightness; });
    double all = 0, below = 0;
    for (const Value& value : values) all += value.solid_angle;
    for (const Value& value : values) {
      below += value.solid_angle;
      if (below >= all / 2) return value.brightness;
    }
    return values.back().brightness;
  }

  const Environment& map_;
  std::vector<double> medians_;
};

// Numbers the groups of pixels that stand out and touch, sides and corners, across the seam and the poles; 0 is none.
class Groups {
 public:
  Groups(const Environment& map, const Surround& surround)
      : map_(map), numbers_(std::size_t(map.height()) * std::size_t(map.width())) {
    for (int y = 0; y < map.height(); ++y)
      for (int x = 0; x < map.width(); ++x)
        if (numbers_[surround.index(y, x)] == 0 && surround.excess(y, x) > 0) flood(surround, y, x);
  }

  int number(std::size_t pixel) const { return numbers_[pixel]; }
  // The one with the most light, the first of equals.
  int brightest() const { return int(std::max_element(light_.begin(), light_.end()) - light_.begin()) + 1; }
  const std::vector<double>& light() const { return light_; }  // of group 1, 2, ...

 private:
  struct Pixel {
    int y, x;
  };

  Pixel neighbour(Pixel pixel, int dy, int dx) const {
    const int width = map_.width();
    Pixel there{pixel.y + dy, pixel.x + dx};
    if (there.y < 0 || there.y >= map_.height()) there = {pixel.y, pixel.x + width / 2 + dx};
    there.x = (there.x + width) % width;
    return there;
  }

  void flood(const Surround& surround, int y, int x) {
    light_.push_back(0);
    const int number = int(light_.size());
    std::vector<Pixel> open{{y, x}};
    numbers_[surround.index(y, x)] = number;
    while (!open.empty()) {
      const Pixel pixel = open.back();
      open.pop_back();
      light_.back() += surround.excess(pixel.y, pixel.x) * map_.solid_angle(pixel.y);
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const Pixel next = neighbour(pixel, dy, dx);
          int& mark = numbers_[surround.index(next.y, next.x)];
          if (mark != 0 || !(surround.excess(next.y, next.x) > 0)) continue;
          mark = number;
          open.push_back(next);
        }
    }
  }

  const Environment& map_;
  std::vector<int> numbers_;
  std::vector<double> light_;
};

}  // namespace

SmallSources small_sources(const Environment& environment) {
  const Environment map =
      environment.resized(std::min(environment.width(), kWidth), std::min(environment.height(), kHeight));
  double all = 0;
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x) all += brightness(map, y, x) * map.solid_angle(y);
  const Surround surround(map);
  const Groups groups(map, surround);
  SmallSources result;
  if (groups.light().empty()) return result;
  for (const double light : groups.light()) result.share += light / all;

  const int brightest = groups.brightest();
  double light = 0, squared = 0;
  core::Vec3 moment;
  core::Direction peak;
  double highest = 0;
  for (int y = 0; y < environment.height(); ++y) {
    const int row = int((2 * std::int64_t(y) + 1) * map.height() / (2 * environment.height()));
    for (int x = 0; x < environment.width(); ++x) {
      const int column = int((2 * std::int64_t(x) + 1) * map.width() / (2 * environment.width()));
      if (groups.number(surround.index(row, column)) != brightest) continue;
      const double excess = surround.excess(brightness(environment, y, x), row, column);
      if (!(excess > 0)) continue;
      const core::Direction direction = environment.direction(y, x);
      const double flux = excess * environment.solid_angle(y);
      light += flux;
      squared += flux * excess;
      moment = moment + flux * direction.vec();
      if (excess > highest) {
        highest = excess;
        peak = direction;
      }
    }
  }
  // A cap of angular diameter d has 2 pi (1 - cos(d / 2)) = 4 pi sin^2(d / 4).
  const double solid_angle = light * light / squared;
  const double diameter = 4 * std::asin(std::min(1.0, std::sqrt(solid_angle / (4 * kPi))));
  const bool has_mean = core::norm(moment) > 1e-6 * light;
  result.brightest = {has_mean ? core::Direction::from_vector(moment) : peak, core::degrees_from_radians(diameter),
                      groups.light()[std::size_t(brightest - 1)] / all};
  return result;
}

}  // namespace lightstage::relight
