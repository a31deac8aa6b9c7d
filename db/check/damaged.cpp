#include "db/check/damaged.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/display.h"
#include "db/check/neighbours.h"
#include "db/check/thumbnail.h"

namespace lightstage::db {
namespace {

constexpr std::size_t kLeastPictures = 16;
constexpr std::size_t kNeighbours = 6;
constexpr double kLeastRatio = 2.5;
constexpr double kLeastDeviations = 5;

struct Judgement {
  double error = 0;   // root mean square distance to the prediction
  double spread = 0;  // root mean square distance of the neighbours to the prediction
};

Judgement judge(std::span<const core::Image> pictures, std::size_t place, std::span<const Neighbour> around,
                const core::Image& mask) {
  double error = 0, spread = 0, area = 0;
  for (std::size_t p = 0; p < pictures[place].values().size(); ++p) {
    const double inside = mask.empty() ? 1 : double(mask.values()[p]);
    double predicted = 0;
    for (const Neighbour& n : around) predicted += n.weight * double(pictures[n.index].values()[p]);
    double variance = 0;  // in two passes: the difference of sums of squares would cancel
    for (const Neighbour& n : around)
      variance += n.weight * std::pow(double(pictures[n.index].values()[p]) - predicted, 2);
    error += inside * std::pow(double(pictures[place].values()[p]) - predicted, 2);
    spread += inside * variance;
    area += inside;
  }
  if (area <= 0) return {};
  return {std::sqrt(error / area), std::sqrt(spread / area)};
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The worst of the usable pictures in one feature, if it is bad enough.
std::optional<Damage> worst(std::span<const core::Direction> directions, std::span<const core::Image> pictures,
                            const core::Image& mask, const std::vector<bool>& usable, DamageKind kind) {
  std::vector<std::size_t> indices;
  std::vector<Judgement> judgements;
  std::vector<double> spreads;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    if (!usable[i]) continue;
    indices.push_back(i);
    judgements.push_back(judge(pictures, i, neighbours(directions, i, kNeighbours, usable), mask));
    spreads.push_back(judgements.back().spread);
  }
  // Where neighbours agree to the last digit, a difference in that digit is no damage.
  const double floor = 0.1 * median(spreads);
  if (!(floor > 0)) return std::nullopt;
  std::vector<double> logarithms;
  for (const Judgement& j : judgements) {
    logarithms.push_back(std::log(std::hypot(j.error, floor) / std::hypot(j.spread, floor)));
  }
  const double centre = median(logarithms);
  std::vector<double> deviations;
  for (const double value : logarithms) deviations.push_back(std::abs(value - centre));
  constexpr double kSigmaOfMad = 1.4826;  // of a normal distribution
  const double sigma = kSigmaOfMad * median(deviations);
  const std::size_t at = std::size_t(std::max_element(logarithms.begin(), logarithms.end()) - logarithms.begin());
  const double ratio = std::exp(logarithms[at]);
  if (ratio < kLeastRatio || logarithms[at] - centre < kLeastDeviations * sigma) return std::nullopt;
  return Damage{indices[at], kind, ratio};
}

// Of the mask's pixels.
double brightness(const core::Image& thumbnail, const core::Image& mask) {
  constexpr double kBrightParts = 0.95;
  std::vector<float> values;
  for (std::size_t p = 0; p < thumbnail.values().size(); ++p) {
    if (mask.empty() || mask.values()[p] > 0.5F) values.push_back(thumbnail.values()[p]);
  }
  return values.empty() ? 0 : core::quantile(values, kBrightParts);
}

}  // namespace

std::vector<Damage> find_black(std::span<const core::Direction> directions, std::span<const core::Image> shapes,
                               const core::Image& mask) {
  constexpr std::size_t kFewest = 3;
  constexpr double kBrighterPictures = 0.9;  // most of a set may be black
  constexpr double kMostInFront = 0.05, kMostBehind = 0.02;
  if (shapes.size() < kFewest) return {};
  std::vector<float> levels;
  for (const core::Image& shape : shapes) levels.push_back(float(brightness(shape, mask)));
  const double usual = core::quantile(levels, kBrighterPictures);
  if (!(usual > 0)) return {};
  const std::vector<bool> all(shapes.size(), true);
  std::vector<Damage> black;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const double share = double(levels[i]) / usual;
    bool found = directions[i].z() > 0 && share < kMostInFront;
    if (!found && share < kMostInFront) {
      double around = 0;
      for (const Neighbour& n : neighbours(directions, i, kNeighbours, all))
        around = std::max(around, double(levels[n.index]));
      found = double(levels[i]) < kMostBehind * around;
    }
    if (found) black.push_back({i, DamageKind::kBlack, std::max(0.0, share)});
  }
  return black;
}

std::vector<Damage> find_damaged(std::span<const core::Direction> directions, std::span<const DamageFeatures> features,
                                 const DamageFeatures& mask) {
  std::vector<core::Image> shapes, details;
  for (const DamageFeatures& f : features) {
    shapes.push_back(core::display_encode(f.shape));
    details.push_back(f.detail);
  }
  std::vector<Damage> damaged;
  std::vector<bool> usable(features.size(), true);
  const bool comparable = !shapes.empty() && shapes.front().values().size() >= kLeastPixelsToCompare;
  while (comparable && std::size_t(std::count(usable.begin(), usable.end(), true)) >= kLeastPictures) {
    const auto in_shape = worst(directions, shapes, mask.shape, usable, DamageKind::kWhole);
    const auto in_rows = worst(directions, details, mask.detail, usable, DamageKind::kRows);
    if (!in_shape && !in_rows) break;
    damaged.push_back(!in_shape || (in_rows && in_rows->ratio > in_shape->ratio) ? *in_rows : *in_shape);
    usable[damaged.back().index] = false;
  }
  std::sort(damaged.begin(), damaged.end(), [](const Damage& a, const Damage& b) { return a.index < b.index; });
  return damaged;
}

}  // namespace lightstage::db
