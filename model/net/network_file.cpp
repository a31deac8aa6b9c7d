#include "model/net/network_file.h"

#include <algorithm>

#include "core/error.h"
#include "model/net/checkpoint_metadata.h"

namespace lightstage::model {

using torch::Tensor;

void write_tensors(const std::filesystem::path& path, const std::map<std::string, std::string>& metadata,
                   const NamedTensors& tensors) {
  const torch::NoGradGuard no_gradients;
  std::vector<Tensor> row_major;  // keeps the numbers alive until they are written
  std::vector<TensorToStore> to_store;
  for (const auto& [name, tensor] : tensors) {
    row_major.push_back(tensor.detach().contiguous());
    to_store.push_back(
        {{name, tensor.sizes().vec()}, {row_major.back().data_ptr<float>(), static_cast<std::size_t>(tensor.numel())}});
  }
  write_safetensors(path, metadata, to_store);
}

void read_tensors(const std::filesystem::path& path, const SafetensorsHeader& header, const NamedTensors& into) {
  std::vector<std::vector<float>> read;
  for (const auto& [name, tensor] : into) {
    const auto found = std::find_if(header.tensors.begin(), header.tensors.end(),
                                    [&, &wanted = name](const auto& stored) { return stored.info.name == wanted; });
    if (found == header.tensors.end() || found->info.shape != tensor.sizes().vec()) {
      throw core::BadInput(path.string() + ": tensor '" + name + "' is missing or of another shape");
    }
    read.push_back(read_tensor(path, *found));
  }
  const torch::NoGradGuard no_gradients;
  for (std::size_t i = 0; i < into.size(); ++i) {
    Tensor target = into[i].second;
    target.copy_(torch::from_blob(read[i].data(), target.sizes()));
  }
}

void save_network(const std::filesystem::path& path, const Network& network, const std::string& provenance) {
  write_tensors(path, checkpoint_metadata(network.config(), provenance), network.parameters());
}

std::unique_ptr<Network> load_network(const std::filesystem::path& path, std::optional<int> neighbours) {
  const SafetensorsHeader header = read_safetensors_header(path);
  NetworkConfig config = checkpoint_info(path, header).config;
  config.neighbours = neighbours.value_or(config.neighbours);
  std::unique_ptr<Network> network = make_network(config, /*seed=*/0);
  read_tensors(path, header, network->parameters());
  return network;
}

}  // namespace lightstage::model
