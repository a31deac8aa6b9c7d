// Networks and tensors as safetensors files.
#pragma once

#include <torch/torch.h>

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "model/net/network.h"
#include "model/net/safetensors.h"

namespace lightstage::model {

using NamedTensors = std::vector<std::pair<std::string, torch::Tensor>>;

// Writes float32 tensors, atomically.
void write_tensors(const std::filesystem::path& path, const std::map<std::string, std::string>& metadata,
                   const NamedTensors& tensors);

// Copies the tensors of a file into tensors of the same names and shapes. Throws BadInput naming the file and the tensor when one is missing
// or of another shape, or as read_tensor does; nothing has been copied then.
void read_tensors(const std::filesystem::path& path, const SafetensorsHeader& header, const NamedTensors& into);

void save_network(const std::filesystem::path& path, const Network& network, const std::string& provenance);
// With another number of neighbours than it was trained with, if one is given. Throws as read_checkpoint_info and read_tensors.
std::unique_ptr<Network> load_network(const std::filesystem::path& path, std::optional<int> neighbours = {});

}  // namespace lightstage::model
