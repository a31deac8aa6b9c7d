// Network weights on disk: one safetensors file, tensors by documented name, configuration and provenance as JSON strings in the header.
// Loading one reads numbers and nothing else: it cannot run code.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace lightstage::model {

// Every size of the network; docs/model.md draws it.
struct NetworkConfig {
  int neighbours = 8;  // k, lights in the active set: 1 to 64
  // Of the encoder's levels: the first at full resolution, each next at half the one before. 1 to 8 levels of 4 to 512 channels,
  // multiples of 4.
  std::vector<int> channels{12, 24, 48, 64};
  // s of the alias-free weights times the squared light spacing (radians), so that it carries to other stages. The network starts as
  // linear blending with this s.
  double sharpness = 4.0;

  friend bool operator==(const NetworkConfig&, const NetworkConfig&) = default;
};

// tiny, small: for minutes and for an hour on two cores. Throws UsageError for another name.
NetworkConfig network_preset(const std::string& name);

struct TensorInfo {
  std::string name;
  std::vector<std::int64_t> shape;

  friend bool operator==(const TensorInfo&, const TensorInfo&) = default;
};

// The tensors that a network of this configuration consists of, in the order in which they are stored. Throws BadInput for a
// configuration out of range.
std::vector<TensorInfo> network_tensors(const NetworkConfig& config);

struct CheckpointInfo {
  NetworkConfig config;
  std::string provenance;  // JSON: scans, steps, seed, program version, losses
  std::vector<TensorInfo> tensors;
  std::size_t parameters = 0;
};

// Reads the header alone. Throws BadInput naming the file, and the tensor where one is to blame: truncated, damaged, wrong shape, wrong
// version, offsets outside the file; a header that claims more than the file holds allocates nothing.
CheckpointInfo read_checkpoint_info(const std::filesystem::path& path);

}  // namespace lightstage::model
