#include "model/checkpoint.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/text.h"
#include "model/net/checkpoint_metadata.h"
#include "model/net/safetensors.h"

namespace lightstage::model {
namespace {

using Json = nlohmann::json;

constexpr const char* kFormat = "lightstage-superres";
constexpr const char* kVersion = "1";
constexpr int kMaxNeighbours = 64;
constexpr std::size_t kMaxLevels = 8;
constexpr int kMaxChannels = 512;
// What the head sees of a neighbour beside its features, and how wide it is inside (docs/model.md).
constexpr int kColourInputs = 4, kGeometryInputs = 7, kHeadChannels = 16;

std::string shape_text(const std::vector<std::int64_t>& shape) {
  std::string text = "[";
  for (const std::int64_t dimension : shape) text += (text.size() > 1 ? ", " : "") + std::to_string(dimension);
  return text + "]";
}

void check(const NetworkConfig& config) {
  const auto fail = [](const std::string& problem) { return core::BadInput("network configuration: " + problem); };
  if (config.neighbours < 1 || config.neighbours > kMaxNeighbours) {
    throw fail("neighbours is " + std::to_string(config.neighbours) + ", must be 1 to " +
               std::to_string(kMaxNeighbours));
  }
  if (config.channels.empty() || config.channels.size() > kMaxLevels) {
    throw fail("there are " + std::to_string(config.channels.size()) + " levels of channels, must be 1 to " +
               std::to_string(kMaxLevels));
  }
  for (const int channels : config.channels) {
    if (channels < 4 || channels > kMaxChannels || channels % 4 != 0) {
      throw fail(std::to_string(channels) + " channels; each level must have 4 to " + std::to_string(kMaxChannels) +
                 ", a multiple of 4");
    }
  }
  if (!std::isfinite(config.sharpness) || config.sharpness <= 0) {
    throw fail("sharpness is " + core::number_text(config.sharpness) + ", must be a finite number > 0");
  }
}

}  // namespace

NetworkConfig network_preset(const std::string& name) {
  if (name == "tiny") return {};
  if (name == "small") return {.neighbours = 8, .channels = {16, 32, 64, 128, 192}, .sharpness = 4.0};
  throw core::UsageError("there is no network preset '" + name + "'; presets are: tiny small");
}

std::vector<TensorInfo> network_tensors(const NetworkConfig& config) {
  check(config);
  std::vector<TensorInfo> tensors;
  const auto add = [&](const std::string& name, std::vector<std::int64_t> shape) {
    tensors.push_back({name, std::move(shape)});
  };
  const auto add_conv = [&](const std::string& name, int out, int in) {
    add(name + ".weight", {out, in, 3, 3});
    add(name + ".bias", {out});
  };
  const auto& channels = config.channels;
  const int levels = int(channels.size());
  for (int level = 0; level < levels; ++level) {
    const std::string name = "encoder." + std::to_string(level);
    const int out = channels[std::size_t(level)];
    add_conv(name + ".conv", out, level == 0 ? 6 : channels[std::size_t(level - 1)]);
    if (level > 0) {
      add(name + ".norm.scale", {out});
      add(name + ".norm.shift", {out});
    }
    add(name + ".slope", {out});
  }
  int decoded = 0;
  for (int level = levels - 2; level >= 0; --level) {
    const std::string name = "decoder." + std::to_string(level);
    const int out = channels[std::size_t(level)];
    const int query = level == levels - 2 ? 3 : 0;  // the query direction enters at the coarsest level
    add_conv(name + ".conv", 4 * out, decoded + channels[std::size_t(level + 1)] + query);
    add(name + ".slope", {out});
    decoded = out;
  }
  const int finest = channels.front();
  add_conv("decoder.join.conv", finest, decoded + finest + 3 + (levels == 1 ? 3 : 0));
  add("decoder.join.slope", {finest});

  const int hidden = kHeadChannels;
  add("head.decoded.weight", {hidden, finest, 1, 1});
  add("head.decoded.bias", {hidden});
  add("head.neighbour.weight", {hidden, finest + kColourInputs, 1, 1});
  add("head.geometry.weight", {hidden, kGeometryInputs});
  add("head.slope", {hidden});
  add("head.logit.weight", {1, hidden, 1, 1});
  add("head.tilt", {2});
  add("log_sharpness", {});
  return tensors;
}

std::string config_to_json(const NetworkConfig& config) {
  return Json{{"neighbours", config.neighbours}, {"channels", config.channels}, {"sharpness", config.sharpness}}.dump();
}

NetworkConfig config_from_json(const std::string& json) {
  NetworkConfig config;
  try {
    const Json parsed = Json::parse(json);
    config.neighbours = parsed.at("neighbours").get<int>();
    config.channels = parsed.at("channels").get<std::vector<int>>();
    config.sharpness = parsed.at("sharpness").get<double>();
  } catch (const Json::exception&) {
    throw core::BadInput("network configuration: needs neighbours, channels and sharpness");
  }
  check(config);
  return config;
}

std::map<std::string, std::string> checkpoint_metadata(const NetworkConfig& config, const std::string& provenance) {
  return {{"format", kFormat}, {"version", kVersion}, {"config", config_to_json(config)}, {"provenance", provenance}};
}

CheckpointInfo checkpoint_info(const std::filesystem::path& path, const SafetensorsHeader& header) {
  const auto fail = [&](const std::string& problem) { return core::BadInput(path.string() + ": " + problem); };
  const auto text = [&](const std::string& key) {
    const auto found = header.metadata.find(key);
    return found == header.metadata.end() ? std::string() : found->second;
  };
  if (text("format") != kFormat) throw fail("is a safetensors file, but not a checkpoint of this program");
  if (text("version") != kVersion) {
    throw fail("is a checkpoint of version '" + text("version") + "', this program reads version " + kVersion);
  }
  CheckpointInfo info;
  try {
    info.config = config_from_json(text("config"));
  } catch (const core::BadInput& error) {
    throw fail(error.what());
  }
  info.provenance = text("provenance");

  const std::vector<TensorInfo> expected = network_tensors(info.config);
  for (const TensorInfo& tensor : expected) {
    const auto found = std::find_if(header.tensors.begin(), header.tensors.end(),
                                    [&](const StoredTensor& stored) { return stored.info.name == tensor.name; });
    if (found == header.tensors.end()) throw fail("tensor '" + tensor.name + "' is missing");
    if (found->info.shape != tensor.shape) {
      throw fail("tensor '" + tensor.name + "' has shape " + shape_text(found->info.shape) +
                 ", the configuration needs " + shape_text(tensor.shape));
    }
    info.parameters += found->value_count;
  }
  if (header.tensors.size() != expected.size()) throw fail("has tensors that are no part of the network");
  info.tensors = expected;
  return info;
}

CheckpointInfo read_checkpoint_info(const std::filesystem::path& path) {
  return checkpoint_info(path, read_safetensors_header(path));
}

}  // namespace lightstage::model
