#include "relight/light_clusters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/error.h"
#include "relight/magnitude.h"

namespace lightstage::relight {

namespace {

enum : char { kLeftOut, kRepresented, kDivided };

double coordinate(core::Vec3 v, int axis) {
  return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

// Of some lights: their box in space, their mean by the light in them, and so on.
struct Extent {
  explicit Extent(std::span<const std::size_t> order, std::span<const DoubtfulLight> lights) {
    double low[3] = {2, 2, 2}, high[3] = {-2, -2, -2}, in_holes = 0;
    core::Vec3 moment, middle;
    for (const std::size_t i : order) {
      const DoubtfulLight& light = lights[i];
      const core::Vec3 v = light.direction.vec();
      const double size = magnitude(light.irradiance);
      irradiance = irradiance + light.irradiance;
      amount += size;
      doubted += size * light.error;
      if (!light.between_lights) in_holes += size;
      moment = moment + size * v;
      middle = middle + v;
      for (int axis = 0; axis < 3; ++axis) {
        low[axis] = std::min(low[axis], coordinate(v, axis));
        high[axis] = std::max(high[axis], coordinate(v, axis));
      }
    }
    // Light from all around has no mean direction; any will do, for such a cluster is divided.
    const bool has_mean = core::norm(moment) > 1e-9 * amount;
    const bool has_middle = core::norm(middle) > 1e-9 * double(order.size());
    centre = has_mean     ? core::Direction::from_vector(moment)
             : has_middle ? core::Direction::from_vector(middle)
                          : lights[order.front()].direction;
    double squares = 0;
    for (const std::size_t i : order)
      squares += magnitude(lights[i].irradiance) * square(core::angle_radians(lights[i].direction, centre));
    spread = amount > 0 ? std::sqrt(squares / amount) : 0;
    for (int axis = 0; axis < 3; ++axis) {
      if (high[axis] - low[axis] > high[widest_axis] - low[widest_axis]) widest_axis = axis;
    }
    width = std::hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
    mostly_in_holes = in_holes > 0.5 * amount;
  }

  core::Vec3 irradiance;
  double amount = 0;   // sum of the sizes
  double doubted = 0;  // each times its error
  core::Direction centre;
  double spread = 0;  // root mean square angle to the centre
  double width = 0;   // diagonal of the box
  int widest_axis = 0;
  bool mostly_in_holes = false;
};

ByPlace at(bool in_hole, double variance) {
  return in_hole ? ByPlace{0, variance} : ByPlace{variance, 0};
}

}  // namespace

ByPlace operator+(const ByPlace& a, const ByPlace& b) {
  return {a.between_lights + b.between_lights, a.in_holes + b.in_holes};
}

ByPlace operator-(const ByPlace& a, const ByPlace& b) {
  return {a.between_lights - b.between_lights, a.in_holes - b.in_holes};
}

ByPlace operator*(const ByPlace& a, const ByPlace& b) {
  return {a.between_lights * b.between_lights, a.in_holes * b.in_holes};
}

ByPlace operator*(double factor, const ByPlace& a) {
  return {factor * a.between_lights, factor * a.in_holes};
}

LightClusters::LightClusters(std::span<const DoubtfulLight> lights, double spacing)
    : correlation_length_(spacing), order_(lights.size()) {
  if (lights.empty()) throw core::UsageError("clusters need at least one light");
  std::iota(order_.begin(), order_.end(), std::size_t(0));
  clusters_.reserve(2 * lights.size());
  build(0, lights.size(), lights, {});
}

std::size_t LightClusters::build(std::size_t first, std::size_t last, std::span<const DoubtfulLight> lights,
                                 std::optional<ByPlace> piece) {
  const std::size_t index = clusters_.size();
  clusters_.emplace_back();
  const std::span<std::size_t> order = std::span(order_).subspan(first, last - first);
  const Extent extent(order, lights);
  constexpr double kWidestInHole = 4;  // correlation lengths
  const bool is_leaf = order.size() == 1;
  const bool is_narrow = extent.width <= correlation_length_ * (extent.mostly_in_holes ? kWidestInHole : 1);
  Cluster cluster;
  cluster.first = first;
  cluster.last = last;
  cluster.centre = extent.centre;
  cluster.irradiance = extent.irradiance;
  cluster.is_piece = !piece && (is_leaf || is_narrow);
  const double shift = std::min(1.0, 2 * extent.spread / correlation_length_);
  cluster.represented = at(extent.mostly_in_holes, square(extent.doubted * shift));
  if (cluster.is_piece) {
    const double error = extent.amount > 0 ? extent.doubted / extent.amount : 0;
    cluster.left_out = at(extent.mostly_in_holes, square(magnitude(extent.irradiance) * error));
    piece = extent.doubted > 0 ? 1 / extent.doubted * cluster.left_out : ByPlace();
  } else if (piece) {
    cluster.left_out = extent.doubted * *piece;
  }
  if (!is_leaf) {
    const std::size_t middle = first + order.size() / 2;
    std::nth_element(order.begin(), order.begin() + std::ptrdiff_t(middle - first), order.end(),
                     [&](std::size_t a, std::size_t b) {
                       const double at_a = coordinate(lights[a].direction.vec(), extent.widest_axis);
                       const double at_b = coordinate(lights[b].direction.vec(), extent.widest_axis);
                       return at_a != at_b ? at_a < at_b : a < b;
                     });
    cluster.left = build(first, middle, lights, piece);
    cluster.right = build(middle, last, lights, piece);
    if (!piece) cluster.left_out = clusters_[cluster.left].left_out + clusters_[cluster.right].left_out;
  }
  clusters_[index] = cluster;
  return index;
}

std::vector<LightClusters::Choice> LightClusters::choices(double price, const ByPlace& weights) const {
  std::vector<Choice> best(clusters_.size());
  for (std::size_t i = clusters_.size(); i-- > 0;) {
    const Cluster& cluster = clusters_[i];
    best[i] = {cluster.left_out.weighed(weights), kLeftOut};
    const double represented = cluster.represented.weighed(weights) + price;
    if (represented < best[i].cost) best[i] = {represented, kRepresented};
    if (cluster.left == 0) continue;
    const double divided = best[cluster.left].cost + best[cluster.right].cost;
    if (divided < best[i].cost) best[i] = {divided, kDivided};
  }
  return best;
}

void LightClusters::collect(std::size_t index, const std::vector<Choice>& choices, Cut& cut) const {
  const Cluster& cluster = clusters_[index];
  switch (choices[index].what) {
    case kDivided:
      collect(cluster.left, choices, cut);
      collect(cluster.right, choices, cut);
      break;
    case kRepresented:
      cut.representatives.push_back({cluster.centre, cluster.irradiance, cluster.left_out - cluster.represented});
      cut.variance = cut.variance + cluster.represented;
      for (std::size_t i = cluster.first; i < cluster.last; ++i) cut.represented[order_[i]] = true;
      break;
    default:
      cut.variance = cut.variance + cluster.left_out;
  }
}

Cut LightClusters::at_price(double price, const ByPlace& weights) const {
  Cut cut;
  cut.represented.resize(order_.size());
  collect(0, choices(price, weights), cut);
  std::stable_sort(cut.representatives.begin(), cut.representatives.end(),
                   [&](const Representative& a, const Representative& b) {
                     return a.saved.weighed(weights) > b.saved.weighed(weights);
                   });
  return cut;
}

// The number of representatives falls, and the variance rises, with the price: bisection of its logarithm.
Cut LightClusters::at_most(std::size_t representatives, const ByPlace& weights) const {
  Cut found = at_price(std::numeric_limits<double>::infinity(), weights);
  double dear = found.variance.weighed(weights), cheap = dear * 1e-18;  // at the dear one nothing pays
  if (representatives == 0 || !(dear > 0)) return found;
  for (int step = 0; step < 60; ++step) {
    const double price = std::sqrt(dear * cheap);
    Cut cut = at_price(price, weights);
    if (cut.representatives.size() > representatives) {
      cheap = price;
    } else {
      dear = price;
      found = std::move(cut);
      if (found.representatives.size() == representatives) break;
    }
  }
  return found;
}

Cut LightClusters::within(double variance, const ByPlace& weights) const {
  Cut none = at_price(std::numeric_limits<double>::infinity(), weights);
  double dear = none.variance.weighed(weights), cheap = dear * 1e-18;
  if (dear <= variance) return none;
  Cut found = at_price(cheap, weights);
  for (int step = 0; step < 60; ++step) {
    const double price = std::sqrt(dear * cheap);
    Cut cut = at_price(price, weights);
    if (cut.variance.weighed(weights) > variance) {
      dear = price;
    } else {
      cheap = price;
      const bool same = cut.representatives.size() == found.representatives.size();
      found = std::move(cut);
      if (same && dear < 1.001 * cheap) break;
    }
  }
  return found;
}

std::vector<LightClusters::Doubt> LightClusters::doubts() const {
  std::vector<Doubt> all;
  for (const Cluster& cluster : clusters_) {
    if (cluster.is_piece && cluster.left_out.total() > 0) all.push_back({cluster.centre, cluster.left_out});
  }
  return all;
}

}  // namespace lightstage::relight
