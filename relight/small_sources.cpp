#include "relight/small_sources.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <vector>

#include "core/parallel.h"

namespace lightstage::relight {

namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kSurroundRadius = 8 * kPi / 180, kSurroundShare = 0.6;
constexpr double kContrast = 2;
constexpr int kWidth = 256, kHeight = 128;

double brightness(const Environment& map, int y, int x) {
  const float* p = map.radiance().pixel(y, x);
  return double(p[0]) + double(p[1]) + double(p[2]);
}

// The area of a moving set of pixels by the rank of their brightness, as in Huang, Yang and Tang 1979, "A fast two-dimensional median filtering
// algorithm", with sums over blocks of ranks so that a quantile is found in two short scans. Areas are whole numbers: what is added and taken away again
// leaves nothing behind.
class Histogram {
 public:
  explicit Histogram(std::size_t ranks) : areas_(ranks), blocks_((ranks - 1) / kBlock + 1) {}

  void add(std::size_t rank, std::int64_t area) {
    areas_[rank] += area;
    blocks_[rank / kBlock] += area;
    all_ += area;
  }
  void clear() {
    std::fill(areas_.begin(), areas_.end(), 0);
    std::fill(blocks_.begin(), blocks_.end(), 0);
    all_ = 0;
  }
  // The lowest rank so that it and those below it have that share of the area.
  std::size_t quantile(double share) const {
    const auto enough = std::int64_t(std::ceil(share * double(all_)));
    std::int64_t below = 0;
    std::size_t block = 0;
    while (below + blocks_[block] < enough) below += blocks_[block++];
    std::size_t rank = block * kBlock;
    while (below + areas_[rank] < enough) below += areas_[rank++];
    return rank;
  }

 private:
  static constexpr std::size_t kBlock = 128;
  std::vector<std::int64_t> areas_, blocks_;
  std::int64_t all_ = 0;
};

// A map's surround, and which pixels stand out of it.
class Surround {
 public:
  explicit Surround(const Environment& map) : map_(map), level_(pixel_count()), ranks_(pixel_count()) {
    rank();
    core::parallel_for(std::size_t(map.height()), 8, [&](std::size_t first, std::size_t last) {
      Histogram histogram(pixel_count());
      for (std::size_t y = first; y < last; ++y) fill_row(int(y), histogram);
    });
  }

  double excess(double brightness, int y, int x) const {
    return std::max(0.0, brightness - kContrast * level_[index(y, x)]);
  }
  double excess(int y, int x) const { return excess(brightness(map_, y, x), y, x); }
  std::size_t index(int y, int x) const { return std::size_t(y) * std::size_t(map_.width()) + std::size_t(x); }

 private:
  // What a disc covers of a row.
  struct Chord {
    int row, columns_to_either_side;
    std::int64_t pixel_area;
  };

  std::size_t pixel_count() const { return std::size_t(map_.height()) * std::size_t(map_.width()); }

  void rank() {
    std::vector<double> values;
    for (int y = 0; y < map_.height(); ++y)
      for (int x = 0; x < map_.width(); ++x) values.push_back(brightness(map_, y, x));
    std::vector<std::size_t> order(values.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
    for (std::size_t i = 0; i < order.size(); ++i) {
      ranks_[order[i]] = i;
      by_rank_.push_back(values[order[i]]);
    }
  }

  // The rows of the disc about any pixel of row y; the pixel itself always belongs to it.
  std::vector<Chord> chords(int y) const {
    const auto latitude = [&](int row) { return kPi * (0.5 - (row + 0.5) / map_.height()); };
    constexpr double kAreaUnits = 0x1p40;  // a steradian
    std::vector<Chord> result;
    for (int row = 0; row < map_.height(); ++row) {
      const double a = latitude(y), b = latitude(row);
      const double cosine = (std::cos(kSurroundRadius) - std::sin(a) * std::sin(b)) / (std::cos(a) * std::cos(b));
      if (cosine > 1 && row != y) continue;
      const double longitude = std::acos(std::clamp(cosine, -1.0, 1.0));
      result.push_back(
          {row, int(longitude / (2 * kPi) * map_.width()), std::llround(map_.solid_angle(row) * kAreaUnits)});
    }
    return result;
  }

  void fill_row(int y, Histogram& histogram) {
    const int width = map_.width();
    const std::vector<Chord> disc = chords(y);
    const auto rank_at = [&](int row, int x) { return ranks_[index(row, (x % width + width) % width)]; };
    histogram.clear();
    for (const Chord& chord : disc) {
      const int half = chord.columns_to_either_side, count = std::min(2 * half + 1, width);
      for (int i = 0; i < count; ++i) histogram.add(rank_at(chord.row, i - half), chord.pixel_area);
    }
    for (int x = 0; x < width; ++x) {
      level_[index(y, x)] = by_rank_[histogram.quantile(kSurroundShare)];
      for (const Chord& chord : disc) {
        const int half = chord.columns_to_either_side;
        if (2 * half + 1 >= width) continue;  // all of the row, wherever the disc is
        histogram.add(rank_at(chord.row, x - half), -chord.pixel_area);
        histogram.add(rank_at(chord.row, x + 1 + half), chord.pixel_area);
      }
    }
  }

  const Environment& map_;
  std::vector<double> level_, by_rank_;
  std::vector<std::size_t> ranks_;
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
    const int row = int((2 * std::int64_t(y) + 1) * map.height() / (2 * std::int64_t(environment.height())));
    for (int x = 0; x < environment.width(); ++x) {
      const int column = int((2 * std::int64_t(x) + 1) * map.width() / (2 * std::int64_t(environment.width())));
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
