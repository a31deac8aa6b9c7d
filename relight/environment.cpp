#include "relight/environment.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"

namespace lightstage::relight {

namespace {

constexpr double kPi = std::numbers::pi;

// Written so that they are exactly antisymmetric about the map's centre and exactly 0 there.
double longitude_radians(int x, int width) {
  return kPi * double(width - 1 - 2 * x) / double(width);
}
double latitude_radians(int y, int height) {
  return kPi * double(height - 1 - 2 * y) / double(2 * height);
}

core::Vec3 on_sphere(double longitude, double latitude) {
  return {std::cos(latitude) * std::sin(longitude), std::sin(latitude), std::cos(latitude) * std::cos(longitude)};
}

// The light of some pixels and where it comes from.
struct Bundle {
  core::Vec3 irradiance;
  core::Vec3 moment;  // direction times energy

  double energy() const { return irradiance.x + irradiance.y + irradiance.z; }
  void add(core::Vec3 more, core::Vec3 direction) {
    irradiance = irradiance + more;
    moment = moment + (more.x + more.y + more.z) * direction;
  }
  void add(const Bundle& other) {
    irradiance = irradiance + other.irradiance;
    moment = moment + other.moment;
  }
  // At the mean direction, unless the light comes from all around (or there is none): then that is rounding.
  DistantLight light(const core::Direction& otherwise) const {
    const bool has_mean = core::norm(moment) > 1e-6 * energy();
    return {has_mean ? core::Direction::from_vector(moment) : otherwise, irradiance};
  }
};

// Pixels from (top, left) to before (bottom, right).
struct Box {
  int top, bottom, left, right;
};

// A map cut into boxes, rows of boxes from the top.
struct Boxes {
  int map_height, map_width;
  int box_height, box_width;

  int rows() const { return (map_height - 1) / box_height + 1; }
  int columns() const { return (map_width - 1) / box_width + 1; }
  Box at(int row, int column) const {
    return {row * box_height, std::min(map_height, (row + 1) * box_height), column * box_width,
            std::min(map_width, (column + 1) * box_width)};
  }
};

// Directions and light of a map's pixels, from one sine and cosine a row and column.
class Pixels {
 public:
  explicit Pixels(const Environment& map) : radiance_(map.radiance()) {
    for (int y = 0; y < map.height(); ++y) {
      const double latitude = latitude_radians(y, map.height());
      rows_.push_back({std::sin(latitude), std::cos(latitude), map.solid_angle(y) / kPi});
    }
    for (int x = 0; x < map.width(); ++x) {
      const double longitude = longitude_radians(x, map.width());
      columns_.push_back({std::sin(longitude), std::cos(longitude)});
    }
  }

  core::Vec3 direction(int y, int x) const {
    const Row& row = rows_[std::size_t(y)];
    const Column& column = columns_[std::size_t(x)];
    return {row.cosine * column.sine, row.sine, row.cosine * column.cosine};
  }
  core::Vec3 irradiance(int y, int x) const {
    const float* p = radiance_.pixel(y, x);
    return rows_[std::size_t(y)].weight * core::Vec3{p[0], p[1], p[2]};
  }
  bool dark(const Box& box) const {
    for (int y = box.top; y < box.bottom; ++y) {
      const float* row = radiance_.pixel(y, box.left);
      if (std::any_of(row, row + 3 * std::ptrdiff_t(box.right - box.left), [](float v) { return v > 0; })) return false;
    }
    return true;
  }
  core::Vec3 middle(const Box& box) const {
    return on_sphere(
        (longitude_radians(box.left, radiance_.width()) + longitude_radians(box.right - 1, radiance_.width())) / 2,
        (latitude_radians(box.top, radiance_.height()) + latitude_radians(box.bottom - 1, radiance_.height())) / 2);
  }
  // No pixel centre of the box is farther than this from its middle: the way there along the meridian and
  // then along the parallel is never shorter than the straight one.
  double radius(const Box& box) const {
    double widest = 0;
    for (int y = box.top; y < box.bottom; ++y) widest = std::max(widest, rows_[std::size_t(y)].cosine);
    return kPi * double(box.bottom - 1 - box.top) / double(2 * radiance_.height()) +
           widest * kPi * double(box.right - 1 - box.left) / double(radiance_.width());
  }

 private:
  struct Row {
    double sine, cosine, weight;
  };
  struct Column {
    double sine, cosine;
  };
  const core::Image& radiance_;
  std::vector<Row> rows_;
  std::vector<Column> columns_;
};

// Gives every pixel of a box to the nearest direction. By the triangle inequality only directions can win
// whose angle to the box's middle is at most that of the nearest one plus twice the box's radius: mostly one
// or a few.
class Gatherer {
 public:
  Gatherer(const Pixels& pixels, const std::vector<core::Direction>& directions)
      : pixels_(pixels), directions_(directions), cosines_(directions.size()), sums_(directions.size()) {}

  void add(const Box& box) {
    if (pixels_.dark(box)) return;
    find_candidates(box);
    std::vector<Bundle> bundles(candidates_.size());
    for (int y = box.top; y < box.bottom; ++y)
      for (int x = box.left; x < box.right; ++x) {
        const core::Vec3 direction = pixels_.direction(y, x);
        std::size_t nearest = 0;
        double best = -2;
        for (std::size_t i = 0; i < candidates_.size(); ++i) {
          const double cosine = core::dot(direction, directions_[candidates_[i]].vec());
          if (cosine > best) {
            best = cosine;
            nearest = i;
          }
        }
        bundles[nearest].add(pixels_.irradiance(y, x), direction);
      }
    for (std::size_t i = 0; i < candidates_.size(); ++i) sums_[candidates_[i]].add(bundles[i]);
  }

  const std::vector<Bundle>& sums() const { return sums_; }

 private:
  void find_candidates(const Box& box) {
    const core::Vec3 middle = pixels_.middle(box);
    double best = -1;
    for (std::size_t i = 0; i < directions_.size(); ++i) {
      cosines_[i] = core::dot(middle, directions_[i].vec());
      best = std::max(best, cosines_[i]);
    }
    constexpr double kRounding = 1e-6;  // of acos near 0 and pi
    const double reach = std::acos(std::min(best, 1.0)) + 2 * pixels_.radius(box) + kRounding;
    const double least = reach < kPi ? std::cos(reach) : -2;
    candidates_.clear();
    for (std::size_t i = 0; i < directions_.size(); ++i)
      if (cosines_[i] >= least) candidates_.push_back(i);
  }

  const Pixels& pixels_;
  const std::vector<core::Direction>& directions_;
  std::vector<double> cosines_;
  std::vector<std::size_t> candidates_;
  std::vector<Bundle> sums_;
};

// Which rows (or columns) of one map a row of another covers, and how much of its area each is; the weights sum to 1.
struct Overlaps {
  int first = 0;
  std::vector<double> weights;
};

// The area of what lies from `low` to `high` of `all` equal steps between the poles, or around the axis, as a share of the sphere.
double parallels_area(std::int64_t low, std::int64_t high, std::int64_t all) {
  const std::int64_t middle = std::min(low + high, 2 * all - low - high);  // from the nearer pole, as in solid_angle
  return std::sin(kPi * double(middle) / double(2 * all)) * std::sin(kPi * double(high - low) / double(2 * all));
}
double meridians_area(std::int64_t low, std::int64_t high, std::int64_t all) {
  return double(high - low) / double(all);
}

// Borders are compared as multiples of 1 / (from to): exactly.
std::vector<Overlaps> overlaps(std::int64_t from, std::int64_t to,
                               double (*area)(std::int64_t, std::int64_t, std::int64_t)) {
  std::vector<Overlaps> result;
  for (std::int64_t i = 0; i < to; ++i) {
    const double whole = area(i * from, (i + 1) * from, from * to);
    Overlaps covered{.first = int(i * from / to), .weights = {}};
    for (std::int64_t j = covered.first; j * to < (i + 1) * from; ++j)
      covered.weights.push_back(area(std::max(j * to, i * from), std::min((j + 1) * to, (i + 1) * from), from * to) /
                                whole);
    result.push_back(std::move(covered));
  }
  return result;
}

}  // namespace

Environment::Environment(core::ImageView radiance) {
  if (radiance.empty()) throw core::BadInput("an environment map needs at least one pixel");
  core::require_finite(radiance, "an environment map");
  radiance_ = core::to_rgb(radiance);
  for (float& v : radiance_.values())
    if (v < 0) {
      v = 0;
      ++negative_values_;
    }
}

Environment Environment::read(const std::filesystem::path& path) {
  return Environment(core::read_image(path));
}

core::Direction Environment::direction(int y, int x) const {
  return core::Direction::from_vector(on_sphere(longitude_radians(x, width()), latitude_radians(y, height())));
}

// sin a - sin b = 2 cos((a + b)/2) sin((a - b)/2); the cosine of the latitude as the sine of the angle to the
// nearer pole keeps all its digits there.
double Environment::solid_angle(int y, int height, int width) {
  const int from_pole = std::min(y, height - 1 - y);
  return 4 * kPi / width * std::sin(kPi * double(2 * from_pole + 1) / double(2 * height)) *
         std::sin(kPi / double(2 * height));
}

Environment Environment::rotated(double degrees) const {
  if (!std::isfinite(degrees)) throw core::UsageError("an environment cannot be turned by an angle that is not finite");
  // Whole turns are taken off without rounding; what the decimals of 360.1 were rounded by before must not make it another
  // angle than 0.1.
  const double angle = std::round(std::remainder(degrees, 360.0) * 1e9) / 1e9;
  // Longitude falls from left to right, so what moves to a larger one moves left.
  const double pixels = angle / 360.0 * width();
  const bool whole = std::abs(pixels - std::round(pixels)) < 1e-9 * (1 + std::abs(pixels));
  const double shift = whole ? std::round(pixels) : std::floor(pixels);
  const double fraction = whole ? 0 : pixels - shift;
  const int start = (static_cast<int>(shift) + width()) % width();
  Environment turned = *this;
  core::parallel_for(std::size_t(height()), 16, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y)
      for (int x = 0; x < width(); ++x) {
        const int source = int((std::int64_t(start) + x) % width());
        const float* here = radiance_.pixel(y, source);
        const float* next = radiance_.pixel(y, (source + 1) % width());
        for (int c = 0; c < 3; ++c)
          turned.radiance_(y, x, c) = float((1 - fraction) * double(here[c]) + fraction * double(next[c]));
      }
  });
  return turned;
}

Environment Environment::resized(int width, int height) const {
  if (width < 1 || height < 1)
    throw core::UsageError("an environment needs at least 1x1 pixels, not " + std::to_string(width) + "x" +
                           std::to_string(height));
  if (width == this->width() && height == this->height()) return *this;
  const std::vector<Overlaps> rows = overlaps(this->height(), height, parallels_area);
  const std::vector<Overlaps> columns = overlaps(this->width(), width, meridians_area);
  core::Image image(height, width, 3);
  core::parallel_for(std::size_t(height), 4, [&](std::size_t first, std::size_t last) {
    std::vector<double> row(3 * std::size_t(this->width()));
    for (std::size_t y = first; y < last; ++y) {
      std::fill(row.begin(), row.end(), 0.0);
      for (std::size_t i = 0; i < rows[y].weights.size(); ++i) {
        const float* source = radiance_.pixel(rows[y].first + int(i), 0);
        for (std::size_t v = 0; v < row.size(); ++v) row[v] += rows[y].weights[i] * double(source[v]);
      }
      for (std::size_t x = 0; x < columns.size(); ++x) {
        core::Vec3 mean;
        const double* source = row.data() + 3 * std::size_t(columns[x].first);
        for (const double weight : columns[x].weights) {
          mean = mean + weight * core::Vec3{source[0], source[1], source[2]};
          source += 3;
        }
        float* pixel = image.pixel(int(y), int(x));
        pixel[0] = float(mean.x);
        pixel[1] = float(mean.y);
        pixel[2] = float(mean.z);
      }
    }
  });
  Environment result(image);
  result.negative_values_ = negative_values_;
  return result;
}

std::vector<DistantLight> Environment::lights(double box_radians) const {
  std::vector<DistantLight> result;
  for (const Patch& patch : patches(box_radians)) {
    if (patch.light.irradiance != core::Vec3{}) result.push_back(patch.light);
  }
  return result;
}

std::vector<Patch> Environment::patches(double box_radians) const {
  if (!(box_radians >= 0)) throw core::UsageError("boxes of an environment need a size of at least 0");
  const auto pixels_in_box = [&](double pixel, int all) {
    return static_cast<int>(std::clamp(std::floor(box_radians / pixel), 1.0, double(all)));
  };
  const Boxes boxes{height(), width(), pixels_in_box(kPi / height(), height()),
                    pixels_in_box(2 * kPi / width(), width())};
  const Pixels pixels(*this);
  const std::size_t columns = std::size_t(boxes.columns());
  std::vector<Patch> result(std::size_t(boxes.rows()) * columns);
  core::parallel_for(std::size_t(boxes.rows()), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t row = first; row < last; ++row)
      for (std::size_t column = 0; column < columns; ++column) {
        const Box box = boxes.at(int(row), int(column));
        const core::Direction middle = core::Direction::from_vector(pixels.middle(box));
        Patch& patch = result[row * columns + column];
        patch = {{middle, {}}, 0};
        for (int y = box.top; y < box.bottom; ++y) patch.solid_angle += solid_angle(y) * (box.right - box.left);
        if (pixels.dark(box)) continue;
        Bundle bundle;
        for (int y = box.top; y < box.bottom; ++y)
          for (int x = box.left; x < box.right; ++x) bundle.add(pixels.irradiance(y, x), pixels.direction(y, x));
        patch.light = bundle.light(middle);
      }
  });
  return result;
}

std::vector<DistantLight> Environment::gather(const std::vector<core::Direction>& directions) const {
  if (directions.empty()) throw core::UsageError("light can only be gathered onto at least one direction");
  constexpr int kBox = 16;             // pixels
  constexpr std::size_t kStrips = 32;  // parts summed apart, whatever the thread count, and then together from the top
  const Boxes boxes{height(), width(), kBox, kBox};
  const Pixels pixels(*this);
  const std::size_t rows = std::size_t(boxes.rows());
  const std::size_t rows_per_strip = (rows - 1) / kStrips + 1;
  std::vector<std::vector<Bundle>> strips((rows - 1) / rows_per_strip + 1);
  core::parallel_for(rows, rows_per_strip, [&](std::size_t first, std::size_t last) {
    Gatherer gatherer(pixels, directions);
    for (std::size_t row = first; row < last; ++row)
      for (int column = 0; column < boxes.columns(); ++column) gatherer.add(boxes.at(int(row), column));
    strips[first / rows_per_strip] = gatherer.sums();
  });
  std::vector<DistantLight> lights;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    Bundle total;
    for (const std::vector<Bundle>& strip : strips) total.add(strip[i]);
    lights.push_back(total.light(directions[i]));
  }
  return lights;
}

}  // namespace lightstage::relight
