// The published network's weights as the engine takes them.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

namespace lightstage::model {

struct SuperresWeights {
  int neighbours;                   // k, lights in an active set
  std::vector<int> channels;        // C_0 .. C_(L-1)
  std::vector<int> query_channels;  // Q_0 ..
  float brightest_input;            // images are limited to this
  // By documented name (docs/model.md), in row-major order; valid while the source lives.
  std::function<std::span<const float>(const std::string& name)> tensor;
};

}  // namespace lightstage::model
