// Network weights on disk: one safetensors file, tensors by documented name, configuration and provenance as JSON strings in the header.
// Loading one reads numbers and nothing else: it cannot run code.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "core/direction.h"

namespace lightstage::model {

enum class Architecture {
  kSuperres,  // the published decoder, which draws the picture from the pooled features (Sun et al. 2020)
  kBlend,     // chooses among the captured pixels and the thin-plate picture, and adds a small residual
  kXu,  // chooses the k lights of the stage that serve every query, and draws the picture from them (Xu et al. 2018)
  kXuAdaptive,  // the same drawing network, from the k lights nearest to the query
  kMeka,        // draws the picture from two colour gradients (Meka et al. 2019)
};

inline constexpr std::array kArchitectures{Architecture::kSuperres, Architecture::kBlend, Architecture::kXu,
                                           Architecture::kXuAdaptive, Architecture::kMeka};

// How the features of the active set become one.
enum class Pooling {
  kAliasFree,  // weighted by W_i: continuous in the query (Sun et al. 2020, section 4.2)
  kAverage,    // the plain mean: jumps where the active set changes; the publication's ablation
};

// Every size of a network; docs/model.md draws them.
struct NetworkConfig {
  Architecture architecture = Architecture::kSuperres;
  int neighbours = 8;  // k, pictures that one is made from: 1 to 64; always 2 in meka
  // Of the encoder's levels, each half as wide and high as the one before: 1 to 8 levels of 4 to 512 channels, multiples of 4. The first is
  // at half the picture's size in superres, at its full size in all others.
  std::vector<int> channels;
  // superres, xu and xu_adaptive: of the fully connected layers on the query's direction, at least one; blend and meka: none.
  std::vector<int> query_channels;
  // s of the alias-free weights times the squared light spacing (radians), so that it carries to other stages; learned from there.
  // xu and meka, which always look at the same pictures, have no such weights.
  double sharpness = 4.0;
  Pooling pooling = Pooling::kAliasFree;  // only superres knows another

  friend bool operator==(const NetworkConfig&, const NetworkConfig&) = default;
};

// "superres", "blend", "xu", "xu_adaptive" or "meka": also the name of the method that uses it.
std::string_view architecture_name(Architecture architecture);

// Whether pictures are pooled with alias-free weights, whose s it learns.
bool has_sharpness(Architecture architecture);

// Throws UsageError for another name.
//   tiny, small   superres for minutes and for an hour on two cores
//   paper         superres as published: 7 levels of 32 to 512 channels
//   blend         the network that is shipped
//   xu, xu_adaptive, meka   these methods at a size for an hour on two cores; docs/model.md tells parameters and operations
NetworkConfig network_preset(const std::string& name);

struct TensorInfo {
  std::string name;
  std::vector<std::int64_t> shape;

  friend bool operator==(const TensorInfo&, const TensorInfo&) = default;
};

// The tensors that a network of this configuration consists of, in the order in which they are stored. Throws BadInput for a
// configuration out of range.
std::vector<TensorInfo> network_tensors(const NetworkConfig& config);

// Floating-point operations of the convolutions for one query, divided by the pixels of the picture: two a product and its sum, with everything computed
// anew. Throws as network_tensors.
double flop_per_pixel(const NetworkConfig& config);

struct CheckpointInfo {
  NetworkConfig config;
  std::string provenance;  // JSON: scans, steps, seed, program version, losses
  std::vector<TensorInfo> tensors;
  std::size_t parameters = 0;
};

// Reads the header alone. Throws BadInput naming the file, and the tensor where one is to blame: truncated, damaged, wrong shape, wrong
// version, offsets outside the file; a header that claims more than the file holds allocates nothing.
CheckpointInfo read_checkpoint_info(const std::filesystem::path& path);

// Of xu: the directions whose nearest lights it looks at, as training chose them, in the order of its pictures. None for the others, which choose by
// the query or look at all. Reads one tensor. Throws as read_checkpoint_info.
std::vector<core::Direction> chosen_directions(const std::filesystem::path& path);

}  // namespace lightstage::model
