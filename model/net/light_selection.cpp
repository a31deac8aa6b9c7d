#include "model/net/light_selection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/sphere.h"

namespace lightstage::model {
namespace {

constexpr double kSelectionShare = 1.0 / 3;
// At first all lights count; at the end logits that are 0.01 apart tell them apart.
constexpr double kFirstSharpness = 1, kLastSharpness = 1000;

}  // namespace

const std::vector<core::Direction>& sampling_candidates() {
  static const std::vector<core::Direction> candidates = core::geodesic_directions(162);
  return candidates;
}

std::vector<std::size_t> nearest_to_candidates(std::span<const core::Direction> lights) {
  std::vector<std::size_t> nearest;
  for (const core::Direction& candidate : sampling_candidates()) {
    nearest.push_back(core::nearest_indices(lights, candidate, 1).front());
  }
  return nearest;
}

std::vector<std::size_t> chosen_candidates(std::span<const float> logits, std::size_t rows) {
  const std::size_t columns = sampling_candidates().size();
  if (rows > columns || logits.size() != rows * columns) throw std::logic_error("sampling logits of another shape");
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> chosen(rows, kNone);
  std::vector<bool> taken(columns, false);
  for (std::size_t turn = 0; turn < rows; ++turn) {
    std::size_t best = kNone;
    for (std::size_t i = 0; i < logits.size(); ++i) {
      if (chosen[i / columns] != kNone || taken[i % columns]) continue;
      if (best == kNone || logits[i] > logits[best]) best = i;
    }
    chosen[best / columns] = best % columns;
    taken[best % columns] = true;
  }
  return chosen;
}

std::vector<std::size_t> lights_for(std::span<const std::size_t> candidates, std::span<const core::Direction> lights) {
  std::vector<std::size_t> result;
  std::vector<bool> taken(lights.size(), false);
  for (const std::size_t candidate : candidates) {
    if (result.size() % lights.size() == 0) std::fill(taken.begin(), taken.end(), false);
    const auto by_distance = core::nearest_indices(lights, sampling_candidates()[candidate], lights.size());
    const auto free =
        std::find_if(by_distance.begin(), by_distance.end(), [&](std::size_t light) { return !taken[light]; });
    taken[*free] = true;
    result.push_back(*free);
  }
  return result;
}

std::optional<double> selection_sharpness(double fraction) {
  if (fraction >= kSelectionShare) return std::nullopt;
  return kFirstSharpness * std::pow(kLastSharpness / kFirstSharpness, std::max(0.0, fraction) / kSelectionShare);
}

double after_selection(double fraction) {
  return std::clamp((fraction - kSelectionShare) / (1 - kSelectionShare), 0.0, 1.0);
}

}  // namespace lightstage::model
