#include "core/sphere.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <numbers>
#include <random>
#include <utility>

#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::core {

namespace {

// Directions closer than this are one (radians, and chord length just as well).
constexpr double kDuplicate = 1e-6;

double squared_chord(const Direction& a, const Direction& b) {
  const Vec3 d = a.vec() - b.vec();
  return dot(d, d);
}

// In cells of a side of the octahedral map: 0.005 degrees.
constexpr std::uint32_t kMapSize = 1 << 16;

// The cell of a direction on the octahedral map: the faces around +y in the middle of the square, those around -y folded out to its corners.
std::array<std::uint32_t, 2> octahedral_cell(const Direction& direction) {
  const Vec3 d = direction.vec();
  const double norm1 = std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
  double u = d.x / norm1, v = d.z / norm1;
  if (d.y < 0) {
    const double folded = std::copysign(1 - std::abs(v), u);
    v = std::copysign(1 - std::abs(u), v);
    u = folded;
  }
  const auto cell = [](double t) { return std::min(kMapSize - 1, std::uint32_t((t + 1) / 2 * kMapSize)); };
  return {cell(u), cell(v)};
}

// How far along the Hilbert curve a cell lies. In each quarter, from the largest to the smallest, the curve is turned so that it enters where it
// left the one before.
std::uint32_t hilbert_distance(std::array<std::uint32_t, 2> cell) {
  auto [x, y] = cell;
  std::uint32_t distance = 0;
  for (std::uint32_t side = kMapSize / 2; side > 0; side /= 2) {
    const bool right = x & side, upper = y & side;
    distance = 4 * distance + (upper ? (right ? 2 : 1) : (right ? 3 : 0));
    if (upper) continue;
    if (right) {
      x = ~x;
      y = ~y;
    }
    std::swap(x, y);
  }
  return distance;
}

}  // namespace

std::vector<Direction> fibonacci_directions(std::size_t n) {
  if (n == 0) throw UsageError("a set of directions needs at least one");
  std::vector<Direction> directions;
  directions.reserve(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double below = (2.0 * double(i) + 1.0) / double(n);  // 1 - y
    const double radius = std::sqrt(below * (2.0 - below));
    const double turns = std::fmod(double(i) / std::numbers::phi, 1.0);
    const double longitude = 2 * std::numbers::pi * turns;
    directions.push_back(
        Direction::from_vector({radius * std::sin(longitude), 1.0 - below, radius * std::cos(longitude)}));
  }
  return directions;
}

std::vector<Direction> geodesic_directions(std::size_t at_least_n) {
  std::size_t frequency = 1;
  while (10 * frequency * frequency + 2 < at_least_n) ++frequency;

  std::vector<Vec3> corners;
  for (const double a : {1.0, -1.0})
    for (const double b : {std::numbers::phi, -std::numbers::phi})
      for (const Vec3 corner : {Vec3{0, a, b}, Vec3{a, b, 0}, Vec3{b, 0, a}}) corners.push_back(corner);
  // Edges of this icosahedron are 2 long; the next distance between corners is 2 phi.
  const auto adjacent = [&](std::size_t i, std::size_t j) { return norm(corners[i] - corners[j]) < 2.5; };

  const double f = double(frequency);
  std::vector<Direction> directions;
  for (const Vec3 corner : corners) directions.push_back(Direction::from_vector(corner));
  for (std::size_t i = 0; i < corners.size(); ++i)
    for (std::size_t j = i + 1; j < corners.size(); ++j) {
      if (!adjacent(i, j)) continue;
      for (std::size_t b = 1; b < frequency; ++b)
        directions.push_back(Direction::from_vector((f - double(b)) * corners[i] + double(b) * corners[j]));
      for (std::size_t k = j + 1; k < corners.size(); ++k) {
        if (!adjacent(i, k) || !adjacent(j, k)) continue;
        for (std::size_t b = 1; b < frequency; ++b)
          for (std::size_t c = 1; b + c < frequency; ++c)
            directions.push_back(Direction::from_vector((f - double(b + c)) * corners[i] + double(b) * corners[j] +
                                                        double(c) * corners[k]));
      }
    }
  return directions;
}

// Marsaglia 1972, "Choosing a point from the surface of a sphere". It needs no function but the square root,
// which IEEE 754 rounds exactly, and the generator's raw output is fixed by the standard: the same directions
// everywhere.
std::vector<Direction> random_directions(std::size_t n, std::uint64_t seed) {
  std::mt19937_64 generator(seed);
  const auto uniform = [&] { return double(generator() >> 11) * 0x1p-52 - 1.0; };  // [-1, 1)
  std::vector<Direction> directions;
  directions.reserve(n);
  while (directions.size() < n) {
    const double u = uniform();
    const double v = uniform();
    const double s = u * u + v * v;
    if (s >= 1) continue;
    const double radius = 2 * std::sqrt(1 - s);
    directions.push_back(Direction::from_vector({u * radius, v * radius, 1 - 2 * s}));
  }
  return directions;
}

std::vector<std::size_t> nearest_indices(std::span<const Direction> directions, const Direction& query, std::size_t k) {
  std::vector<std::pair<double, std::size_t>> order;
  order.reserve(directions.size());
  // The chord tells close directions apart where the dot product rounds to 1.
  for (std::size_t i = 0; i < directions.size(); ++i) order.emplace_back(squared_chord(directions[i], query), i);
  const auto middle = order.begin() + std::ptrdiff_t(std::min(k, order.size()));
  if (middle != order.end()) std::nth_element(order.begin(), middle, order.end());
  std::sort(order.begin(), middle);
  std::vector<std::size_t> indices;
  for (auto entry = order.begin(); entry != middle; ++entry) indices.push_back(entry->second);
  return indices;
}

std::vector<std::size_t> neighbouring_order(std::span<const Direction> directions) {
  std::vector<std::pair<std::uint32_t, std::size_t>> places;
  for (std::size_t i = 0; i < directions.size(); ++i)
    places.emplace_back(hilbert_distance(octahedral_cell(directions[i])), i);
  std::sort(places.begin(), places.end());
  std::vector<std::size_t> order;
  for (const auto& [place, i] : places) order.push_back(i);
  return order;
}

double median_spacing_radians(std::span<const Direction> directions) {
  std::vector<double> spacings(directions.size());
  parallel_for(directions.size(), 64, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      double nearest = 4;
      for (const Direction& other : directions) {
        const double chord2 = squared_chord(directions[i], other);
        if (chord2 >= kDuplicate * kDuplicate) nearest = std::min(nearest, chord2);
      }
      spacings[i] = 2 * std::asin(std::sqrt(std::min(nearest, 4.0)) / 2);
    }
  });
  if (spacings.empty()) return std::numbers::pi;
  const auto middle = spacings.begin() + std::ptrdiff_t(spacings.size() / 2);
  std::nth_element(spacings.begin(), middle, spacings.end());
  if (spacings.size() % 2 == 1) return *middle;
  return (*middle + *std::max_element(spacings.begin(), middle)) / 2;
}

std::vector<double> voronoi_solid_angles(std::span<const Direction> directions, std::size_t samples) {
  if (directions.empty()) return {};
  if (samples == 0) throw UsageError("solid angles need at least one sample");

  // Each direction's stand-in: the first one that is the same as it.
  std::vector<std::size_t> stand_in(directions.size());
  std::vector<std::size_t> distinct;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const auto same = std::find_if(distinct.begin(), distinct.end(), [&](std::size_t j) {
      return squared_chord(directions[i], directions[j]) < kDuplicate * kDuplicate;
    });
    stand_in[i] = same != distinct.end() ? *same : i;
    if (same == distinct.end()) distinct.push_back(i);
  }

  const std::vector<Direction> points = fibonacci_directions(samples);
  std::vector<std::size_t> hits(directions.size());
  std::mutex mutex;
  parallel_for(points.size(), 4096, [&](std::size_t first, std::size_t last) {
    std::vector<std::size_t> found;
    for (std::size_t p = first; p < last; ++p) {
      double best = -2;
      std::size_t nearest = 0;
      for (const std::size_t i : distinct) {
        const double cosine = dot(directions[i].vec(), points[p].vec());
        if (cosine > best) {
          best = cosine;
          nearest = i;
        }
      }
      found.push_back(nearest);
    }
    const std::lock_guard lock(mutex);
    for (const std::size_t i : found) ++hits[i];  // integers: the order does not matter
  });

  std::vector<std::size_t> sharers(directions.size());
  for (const std::size_t i : stand_in) ++sharers[i];
  std::vector<double> angles;
  for (const std::size_t i : stand_in)
    angles.push_back(4 * std::numbers::pi * double(hits[i]) / double(samples) / double(sharers[i]));
  return angles;
}

}  // namespace lightstage::core
