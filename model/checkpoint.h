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
  int neighbours = 8;                   // k: lights in the active set
  std::vector<int> channels{16, 32, 64, 96};  // of the encoder's levels: the first at full resolution, each next at half the one before
  double sharpness = 2.0;               // s of the alias-free weights times the squared light spacing (radians), so that it carries to other stages
};

// tiny, small: for minutes and for an hour on two cores. Throws UsageError for another name.
NetworkConfig network_preset(const std::string& name);

struct TensorInfo {
  std::string name;
  std::vector<std::int64_t> shape;
};

struct CheckpointInfo {
  NetworkConfig config;
  std::string provenance;   // JSON: scans, steps, seed, program version, losses
  std::vector<TensorInfo> tensors;
  std::size_t parameters = 0;
};

// Reads the header alone. Throws BadInput naming the file, and the tensor where one is to blame: truncated, damaged, wrong shape, wrong
// version, offsets outside the file; a header that claims more than the file holds allocates nothing.
CheckpointInfo read_checkpoint_info(const std::filesystem::path& path);

}  // namespace lightstage::model
