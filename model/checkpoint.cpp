#include "model/checkpoint.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/text.h"
#include "model/net/checkpoint_metadata.h"
#include "model/net/light_selection.h"
#include "model/net/safetensors.h"

namespace lightstage::model {
namespace {

using Json = nlohmann::json;

constexpr const char* kFormat = "lightstage-network";
constexpr const char* kVersion = "2";
constexpr int kMaxNeighbours = 64;
constexpr std::size_t kMaxLevels = 8;
constexpr int kMaxChannels = 512;
// blend: what the encoder and the head are told of a neighbour beside its pixels, and how wide the head is inside.
constexpr int kPlaceInputs = 8, kHeadChannels = 16;
constexpr int kGradients = 2;  // pictures that meka sees

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
  const auto check_channels = [&](const std::vector<int>& layers) {
    for (const int channels : layers) {
      if (channels < 4 || channels > kMaxChannels || channels % 4 != 0) {
        throw fail(std::to_string(channels) + " channels; each layer must have 4 to " + std::to_string(kMaxChannels) +
                   ", a multiple of 4");
      }
    }
  };
  check_channels(config.channels);
  check_channels(config.query_channels);
  const std::string name(architecture_name(config.architecture));
  const bool asks_by_layers = config.architecture != Architecture::kBlend && config.architecture != Architecture::kMeka;
  if (config.query_channels.size() > kMaxLevels || config.query_channels.empty() == asks_by_layers) {
    throw fail(name + (asks_by_layers ? " needs 1 to 8 query_channels" : " has no query_channels"));
  }
  if (config.architecture != Architecture::kSuperres && config.pooling != Pooling::kAliasFree) {
    throw fail(name + " pools alias_free only");
  }
  if (config.architecture == Architecture::kMeka && config.neighbours != kGradients) {
    throw fail("meka sees two gradient pictures and no neighbours: neighbours must be 2");
  }
  if (!std::isfinite(config.sharpness) || config.sharpness <= 0) {
    throw fail("sharpness is " + core::number_text(config.sharpness) + ", must be a finite number > 0");
  }
}

// Tensors, by the parts that both networks are made of.
struct TensorList {
  std::vector<TensorInfo> all;

  void add(const std::string& name, std::vector<std::int64_t> shape) { all.push_back({name, std::move(shape)}); }
  void add_conv(const std::string& name, int out, int in, int size = 3) {
    add(name + ".conv.weight", {out, in, size, size});
    add(name + ".conv.bias", {out});
  }
  void add_norm(const std::string& name, int channels) {
    add(name + ".norm.scale", {channels});
    add(name + ".norm.shift", {channels});
  }
  void add_slope(const std::string& name, int channels) { add(name + ".slope", {channels}); }
};

std::string numbered(const char* name, int number) {
  return name + ("." + std::to_string(number));
}

// Fully connected layers on the query's direction; returns the width of the last.
int add_query_layers(TensorList& tensors, const NetworkConfig& config) {
  int width = 3;
  for (int layer = 0; layer < int(config.query_channels.size()); ++layer) {
    const std::string name = numbered("query", layer);
    const int out = config.query_channels[std::size_t(layer)];
    tensors.add(name + ".weight", {out, width});
    tensors.add(name + ".bias", {out});
    tensors.add_norm(name, out);
    tensors.add_slope(name, out);
    width = out;
  }
  return width;
}

void add_superres(TensorList& tensors, const NetworkConfig& config) {
  const auto& channels = config.channels;
  const int levels = int(channels.size());
  // What leaves the encoder before level l has the channels of l - 1; decoder l gives them back.
  const auto outer = [&](int level) { return channels[std::size_t(std::max(level - 1, 0))]; };
  for (int level = 0; level < levels; ++level) {
    const std::string name = numbered("encoder", level);
    tensors.add_conv(name, channels[std::size_t(level)], level == 0 ? 6 : outer(level));
    tensors.add_norm(name, channels[std::size_t(level)]);
    tensors.add_slope(name, channels[std::size_t(level)]);
  }
  int width = add_query_layers(tensors, config);
  for (int level = levels - 1; level >= 0; --level) {
    const std::string name = numbered("decoder", level);
    const int out = outer(level);
    tensors.add(name + ".conv.weight",
                {width + channels[std::size_t(level)], out, 3, 3});  // as conv_transpose2d takes it
    tensors.add(name + ".conv.bias", {out});
    tensors.add_norm(name, out);
    tensors.add_slope(name, out);
    width = out;
  }
  for (int level = 0; level < levels; ++level) {
    tensors.add_conv(numbered("output", level), 3, outer(level));
    if (level == 0) continue;
    tensors.add_conv(numbered("inject", level), outer(level), 6, 1);
    tensors.add_slope(numbered("inject", level), outer(level));
  }
}

void add_blend(TensorList& tensors, const NetworkConfig& config) {
  const auto& channels = config.channels;
  const int levels = int(channels.size());
  const int finest = channels.front();
  for (int level = 0; level < levels; ++level) {
    const std::string name = numbered("encoder", level);
    const int out = channels[std::size_t(level)];
    tensors.add_conv(name, out, level == 0 ? 6 : channels[std::size_t(level - 1)]);
    if (level == 0) {
      tensors.add(name + ".place.weight", {out, kPlaceInputs});
    } else {
      tensors.add_norm(name, out);
    }
    tensors.add_slope(name, out);
  }
  tensors.add_conv("guide", finest, 3);
  tensors.add_slope("guide", finest);
  int width = 2 * channels.back();  // mean and spread
  for (int level = levels - 2; level >= 0; --level) {
    const std::string name = numbered("decoder", level);
    const int out = channels[std::size_t(level)];
    tensors.add_conv(name, 4 * out, width);
    tensors.add_slope(name, out);
    width = 3 * out;
  }
  tensors.add_conv("join", 2 * finest, width + finest);
  tensors.add_slope("join", 2 * finest);
  tensors.add("head.joined.weight", {kHeadChannels, 2 * finest, 1, 1});
  tensors.add("head.joined.bias", {kHeadChannels});
  tensors.add("head.neighbour.weight", {kHeadChannels, finest + 3, 1, 1});
  tensors.add("head.place.weight", {kHeadChannels, kPlaceInputs});
  tensors.add_slope("head", kHeadChannels);
  tensors.add("head.logit.weight", {1, kHeadChannels, 1, 1});
  tensors.add("head.logit.bias", {1});
  tensors.add_conv("residual", 3, 2 * finest);
}

// xu, xu_adaptive and meka.
void add_u_net(TensorList& tensors, const NetworkConfig& config) {
  const auto& channels = config.channels;
  const int levels = int(channels.size());
  const int finest = channels.front();
  constexpr int kDirection = 3;
  const int picture_and_light = 3 + kDirection;
  int width = picture_and_light;  // one picture at a time
  if (config.architecture == Architecture::kXu) {
    tensors.add("sampling.logits", {config.neighbours, std::int64_t(sampling_candidates().size())});
    width = config.neighbours * picture_and_light;
  } else if (config.architecture == Architecture::kMeka) {
    width = 3 * kGradients + kDirection;
  }
  for (int level = 0; level < levels; ++level) {
    const std::string name = numbered("encoder", level);
    const int out = channels[std::size_t(level)];
    tensors.add_conv(name, out, width);
    if (level > 0) tensors.add_norm(name, out);
    tensors.add_slope(name, out);
    width = out;
  }
  if (!config.query_channels.empty()) width += add_query_layers(tensors, config);
  for (int level = levels - 2; level >= 0; --level) {
    const std::string name = numbered("decoder", level);
    const int out = channels[std::size_t(level)];
    tensors.add(name + ".conv.weight", {width, out, 3, 3});  // as conv_transpose2d takes it
    tensors.add(name + ".conv.bias", {out});
    tensors.add_norm(name, out);
    tensors.add_slope(name, out);
    width = 2 * out;
  }
  tensors.add_conv("join", finest, width);
  tensors.add_slope("join", finest);
  tensors.add_conv("output", 3, finest);
}

}  // namespace

std::string_view architecture_name(Architecture architecture) {
  switch (architecture) {
    case Architecture::kSuperres:
      return "superres";
    case Architecture::kBlend:
      return "blend";
    case Architecture::kXu:
      return "xu";
    case Architecture::kXuAdaptive:
      return "xu_adaptive";
    case Architecture::kMeka:
      break;
  }
  return "meka";
}

bool has_sharpness(Architecture architecture) {
  return architecture != Architecture::kXu && architecture != Architecture::kMeka;
}

NetworkConfig network_preset(const std::string& name) {
  if (name == "tiny") return {.channels = {16, 32, 48, 64}, .query_channels = {16, 32}};
  if (name == "small") return {.channels = {16, 32, 64, 128, 192}, .query_channels = {32, 64, 128}};
  if (name == "paper") return {.channels = {32, 64, 128, 256, 512, 512, 512}, .query_channels = {32, 128, 512}};
  if (name == "blend") return {.architecture = Architecture::kBlend, .channels = {16, 32, 64, 96, 128}};
  if (name == "xu" || name == "xu_adaptive") {
    return {.architecture = name == "xu" ? Architecture::kXu : Architecture::kXuAdaptive,
            .channels = {24, 48, 96, 160, 224},
            .query_channels = {32, 128}};
  }
  if (name == "meka") {
    return {.architecture = Architecture::kMeka, .neighbours = kGradients, .channels = {24, 48, 96, 160, 224}};
  }
  throw core::UsageError("there is no network preset '" + name +
                         "'; presets are: tiny small paper blend xu xu_adaptive meka");
}

std::vector<TensorInfo> network_tensors(const NetworkConfig& config) {
  check(config);
  TensorList tensors;
  if (config.architecture == Architecture::kSuperres) {
    add_superres(tensors, config);
  } else if (config.architecture == Architecture::kBlend) {
    add_blend(tensors, config);
  } else {
    add_u_net(tensors, config);
  }
  if (has_sharpness(config.architecture)) tensors.add("log_sharpness", {});
  return std::move(tensors.all);
}

double flop_per_pixel(const NetworkConfig& config) {
  const bool superres = config.architecture == Architecture::kSuperres,
             blend = config.architecture == Architecture::kBlend;
  double sum = 0;
  for (const TensorInfo& tensor : network_tensors(config)) {
    const std::string_view name = tensor.name;
    // inject and the coarser outputs serve training alone.
    if (tensor.shape.size() != 4 || name.starts_with("inject")) continue;
    const auto dot = name.find('.');
    const int level = std::isdigit(static_cast<unsigned char>(name[dot + 1])) ? name[dot + 1] - '0' : 0;
    const bool encoder = name.starts_with("encoder"), decoder = name.starts_with("decoder");
    if (name.starts_with("output") && level > 0) continue;
    // Decoders are counted by the pixels that they read, all others by those that they write.
    const double pixels = std::pow(0.25, level + (decoder || (superres && encoder) ? 1 : 0));
    const bool each_image = superres ? encoder
                            : blend  ? encoder || name.starts_with("head.neighbour") || name.starts_with("head.logit")
                                    : config.architecture == Architecture::kXuAdaptive && name.starts_with("encoder.0");
    sum += 2 * double(value_count(tensor)) * pixels * (each_image ? config.neighbours : 1);
  }
  return sum;
}

std::string config_to_json(const NetworkConfig& config) {
  return Json{{"architecture", architecture_name(config.architecture)},
              {"neighbours", config.neighbours},
              {"channels", config.channels},
              {"query_channels", config.query_channels},
              {"sharpness", config.sharpness},
              {"pooling", config.pooling == Pooling::kAliasFree ? "alias_free" : "average"}}
      .dump();
}

NetworkConfig config_from_json(const std::string& json) {
  NetworkConfig config;
  try {
    const Json parsed = Json::parse(json);
    // The place of the text under a key among those allowed.
    const auto one_of = [&](const char* key, const std::vector<std::string>& allowed) {
      const auto name = parsed.at(key).get<std::string>();
      const auto found = std::find(allowed.begin(), allowed.end(), name);
      if (found == allowed.end()) {
        throw core::BadInput("network configuration: " + std::string(key) + " is '" + name + "', must be " +
                             core::joined(allowed, " or "));
      }
      return std::size_t(found - allowed.begin());
    };
    std::vector<std::string> architectures;
    for (const Architecture architecture : kArchitectures) architectures.emplace_back(architecture_name(architecture));
    config.architecture = kArchitectures[one_of("architecture", architectures)];
    // The parser would make whole numbers of others by cutting off what does not fit.
    const auto whole = [](const char* key, const Json& number) {
      if (!number.is_number_unsigned() || number.get<std::uint64_t>() > std::uint64_t(kMaxChannels)) {
        throw core::BadInput("network configuration: " + std::string(key) + " has " + number.dump() +
                             ", must have whole numbers up to " + std::to_string(kMaxChannels));
      }
      return number.get<int>();
    };
    const auto list = [&](const char* key) {
      std::vector<int> numbers;
      for (const Json& number : parsed.at(key).get_ref<const Json::array_t&>()) numbers.push_back(whole(key, number));
      return numbers;
    };
    config.neighbours = whole("neighbours", parsed.at("neighbours"));
    config.channels = list("channels");
    config.query_channels = list("query_channels");
    config.sharpness = parsed.at("sharpness").get<double>();
    config.pooling = one_of("pooling", {"alias_free", "average"}) == 0 ? Pooling::kAliasFree : Pooling::kAverage;
  } catch (const Json::exception&) {
    throw core::BadInput(
        "network configuration: needs architecture, neighbours, channels, query_channels, sharpness and pooling");
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

std::vector<core::Direction> chosen_directions(const std::filesystem::path& path) {
  const SafetensorsHeader header = read_safetensors_header(path);
  if (checkpoint_info(path, header).config.architecture != Architecture::kXu) return {};
  const auto logits = std::find_if(header.tensors.begin(), header.tensors.end(),
                                   [](const StoredTensor& stored) { return stored.info.name == "sampling.logits"; });
  std::vector<core::Direction> chosen;
  for (const std::size_t candidate : chosen_candidates(read_tensor(path, *logits), std::size_t(logits->info.shape[0])))
    chosen.push_back(sampling_candidates()[candidate]);
  return chosen;
}

}  // namespace lightstage::model
