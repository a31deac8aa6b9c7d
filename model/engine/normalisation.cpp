#include "model/engine/normalisation.h"

#include <algorithm>
#include <cmath>

#include "model/engine/feature_map.h"

namespace lightstage::model {
namespace {

constexpr double kEpsilon = 1e-5;

struct Distribution {
  double count = 0, mean = 0, squares = 0;  // squares: summed about the mean

  // Chan, Golub and LeVeque 1983, "Algorithms for computing the sample variance", equation 2.1.
  void merge(const Distribution& other) {
    if (other.count == 0) return;
    const double total = count + other.count, step = other.mean - mean;
    squares += other.squares + step * step * count * other.count / total;
    mean += step * other.count / total;
    count = total;
  }
};

Distribution distribution(const Moments& m, int lane) {
  if (m.count == 0) return {};
  const double mean = m.sum[lane] / m.count;
  return {m.count, double(m.pivot[lane]) + mean, std::max(0.0, m.squares[lane] - mean * m.sum[lane])};
}

}  // namespace

NormPreluWeights norm_prelu_weights(const SuperresWeights& weights, const std::string& layer) {
  const auto copy = [&](const char* name) {
    const std::span<const float> values = weights.tensor(layer + name);
    return std::vector<float>(values.begin(), values.end());
  };
  return {copy(".norm.scale"), copy(".norm.shift"), copy(".slope")};
}

std::vector<BlockAffine> group_norm(std::span<const Moments> parts, std::size_t parts_per_pair,
                                    const NormPreluWeights& weights) {
  const int channels = int(weights.scale.size());
  const int per_group = channels % 8 == 0 ? 8 : 4;
  std::vector<BlockAffine> result(std::size_t(blocks_of(channels)), BlockAffine{});
  for (int first = 0; first < channels; first += per_group) {
    Distribution group;
    for (int c = first; c < first + per_group; ++c) {
      for (std::size_t part = 0; part < parts_per_pair; ++part) {
        group.merge(distribution(parts[std::size_t(c / (2 * kLanes)) * parts_per_pair + part], c % (2 * kLanes)));
      }
    }
    const double inverse = 1 / std::sqrt(group.squares / group.count + kEpsilon);
    for (int c = first; c < first + per_group; ++c) {
      BlockAffine& block = result[std::size_t(c / kLanes)];
      const double gain = double(weights.scale[std::size_t(c)]) * inverse;
      block.gain[c % kLanes] = float(gain);
      block.offset[c % kLanes] = float(double(weights.shift[std::size_t(c)]) - gain * group.mean);
      block.slope[c % kLanes] = weights.slope[std::size_t(c)];
    }
  }
  return result;
}

}  // namespace lightstage::model
