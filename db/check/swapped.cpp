#include "db/check/swapped.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/display.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "db/check/thumbnail.h"

namespace lightstage::db {
namespace {

constexpr std::size_t kNeighbours = 12;
constexpr std::size_t kLeastPictures = 16;
constexpr double kLeastGain = 1.15;
// Share of the squared difference between nearest neighbours: differences well below it are no evidence.
constexpr double kNoiseShare = 0.05;
// Lights that are nearly in one place must not make the equations singular.
constexpr double kSofteningOfNearest = 0.02, kLeastSoftening = 1e-4;

using Shading = std::vector<double>;

struct Weight {
  std::size_t index = 0;
  double value = 0;
};

Shading shading_of(const core::Image& thumbnail, const core::Image& mask) {
  const core::Image shown = core::display_encode(thumbnail);
  Shading shading;
  double squares = 0;
  for (std::size_t p = 0; p < shown.values().size(); ++p) {
    shading.push_back((mask.empty() ? 1 : std::sqrt(double(mask.values()[p]))) * double(shown.values()[p]));
    squares += shading.back() * shading.back();
  }
  constexpr double kBlack = 1e-12;
  if (squares > kBlack)
    for (double& value : shading) value /= std::sqrt(squares);
  return shading;
}

double squared_distance(const Shading& a, const Shading& b) {
  double sum = 0;
  for (std::size_t p = 0; p < a.size(); ++p) sum += (a[p] - b[p]) * (a[p] - b[p]);
  return sum;
}

// Solves a x = b in place by elimination with pivots; false where that cannot be.
bool solve(std::vector<double> a, std::vector<double>& b) {
  const std::size_t n = b.size();
  for (std::size_t column = 0; column < n; ++column) {
    std::size_t pivot = column;
    for (std::size_t row = column + 1; row < n; ++row)
      if (std::abs(a[row * n + column]) > std::abs(a[pivot * n + column])) pivot = row;
    constexpr double kSingular = 1e-12;
    if (std::abs(a[pivot * n + column]) < kSingular) return false;
    for (std::size_t k = 0; k < n; ++k) std::swap(a[pivot * n + k], a[column * n + k]);
    std::swap(b[pivot], b[column]);
    for (std::size_t row = column + 1; row < n; ++row) {
      const double factor = a[row * n + column] / a[column * n + column];
      for (std::size_t k = column; k < n; ++k) a[row * n + k] -= factor * a[column * n + k];
      b[row] -= factor * b[column];
    }
  }
  for (std::size_t row = n; row-- > 0;) {
    for (std::size_t k = row + 1; k < n; ++k) b[row] -= a[row * n + k] * b[k];
    b[row] /= a[row * n + row];
  }
  return true;
}

class Comparison {
 public:
  Comparison(std::span<const core::Direction> directions, std::vector<Shading> shadings)
      : directions_(directions), shadings_(std::move(shadings)), nearest_(directions.size()) {
    core::parallel_for(directions.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        nearest_[i] = core::nearest_indices(directions_, directions_[i], std::min(directions_.size(), kNeighbours + 3));
        std::erase(nearest_[i], i);
      }
    });
    std::vector<float> differences;
    for (std::size_t i = 0; i < shadings_.size(); ++i)
      differences.push_back(float(squared_distance(shadings_[i], shadings_[nearest_[i].front()])));
    noise_ = kNoiseShare * core::quantile(differences, 0.5);
  }

  // Where neighbours agree to the last digit, there is nothing to tell by.
  bool can_tell() const { return noise_ > 0; }

  void swap(std::size_t a, std::size_t b) { std::swap(shadings_[a], shadings_[b]); }

  struct Pair {
    std::size_t a = 0, b = 0;
    double gain = 0;
  };
  // The pair that gains most by being swapped back.
  Pair best() const {
    const std::size_t count = directions_.size();
    std::vector<Shading> predictions(count);
    std::vector<Pair> of_each(count);
    core::parallel_for(count, 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) predictions[i] = predict(i, i);
    });
    core::parallel_for(count, 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t a = first; a < last; ++a) {
        of_each[a] = {a, a, 0};
        for (std::size_t b = a + 1; b < count; ++b) {
          const double gain = gain_of(a, b, predictions);
          if (gain > of_each[a].gain) of_each[a] = {a, b, gain};
        }
      }
    });
    return *std::max_element(of_each.begin(), of_each.end(),
                             [](const Pair& x, const Pair& y) { return x.gain < y.gain; });
  }

 private:
  bool is_used(std::size_t index, std::size_t place) const {
    const auto end = nearest_[place].begin() + std::ptrdiff_t(std::min(kNeighbours, nearest_[place].size()));
    return std::find(nearest_[place].begin(), end, index) != end;
  }

  double gain_of(std::size_t a, std::size_t b, const std::vector<Shading>& predictions) const {
    const Shading at_a = is_used(b, a) ? predict(a, b) : predictions[a];
    const Shading at_b = is_used(a, b) ? predict(b, a) : predictions[b];
    const double own = squared_distance(shadings_[a], at_a) + squared_distance(shadings_[b], at_b);
    const double swapped = squared_distance(shadings_[a], at_b) + squared_distance(shadings_[b], at_a);
    return std::sqrt((own + noise_) / (swapped + noise_));
  }

  // At a place, from the nearest lights without itself and another one.
  Shading predict(std::size_t place, std::size_t without) const {
    Shading prediction(shadings_.front().size());
    for (const Weight& weight : weights(place, without)) {
      for (std::size_t p = 0; p < prediction.size(); ++p) prediction[p] += weight.value * shadings_[weight.index][p];
    }
    return prediction;
  }

  std::vector<Weight> weights(std::size_t place, std::size_t without) const {
    std::vector<Weight> used;
    for (const std::size_t i : nearest_[place]) {
      if (i != without && used.size() < kNeighbours) used.push_back({i, 0});
    }
    const auto angle = [&](std::size_t i, std::size_t j) {
      return core::angle_radians(directions_[i], directions_[j]);
    };
    // Angles are conditionally negative definite: subtracting from the diagonal keeps the system regular.
    const std::size_t n = used.size() + 1;
    std::vector<double> matrix(n * n), solution(n, 1);
    for (std::size_t i = 0; i + 1 < n; ++i) {
      for (std::size_t j = 0; j + 1 < n; ++j) matrix[i * n + j] = angle(used[i].index, used[j].index);
      matrix[i * n + i] = -(kSofteningOfNearest * angle(place, used.front().index) + kLeastSoftening);
      matrix[i * n + n - 1] = matrix[(n - 1) * n + i] = 1;
      solution[i] = angle(place, used[i].index);
    }
    const bool solved = solve(matrix, solution);
    for (std::size_t i = 0; i < used.size(); ++i) used[i].value = solved ? solution[i] : 1 / double(used.size());
    return used;
  }

  std::span<const core::Direction> directions_;
  std::vector<Shading> shadings_;
  std::vector<std::vector<std::size_t>> nearest_;
  double noise_ = 0;
};

}  // namespace

std::vector<std::pair<std::size_t, std::size_t>> find_swapped(std::span<const core::Direction> directions,
                                                              std::span<const core::Image> thumbnails,
                                                              const core::Image& mask) {
  if (directions.size() < kLeastPictures) return {};
  if (thumbnails.front().values().size() < kLeastPixelsToCompare) return {};
  std::vector<Shading> shadings;
  for (const core::Image& thumbnail : thumbnails) shadings.push_back(shading_of(thumbnail, mask));
  Comparison comparison(directions, std::move(shadings));
  std::vector<std::pair<std::size_t, std::size_t>> found;
  // Worst first, and put right before the next is looked for: two that are swapped do not accuse those around them.
  while (comparison.can_tell() && found.size() < directions.size() / 2) {
    const auto [a, b, gain] = comparison.best();
    if (gain < kLeastGain) break;
    comparison.swap(a, b);
    found.emplace_back(a, b);
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace lightstage::db
