#include "model/net/training_state.h"

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "model/net/network_file.h"

namespace lightstage::model {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using AdamState = torch::optim::AdamParamState;
using torch::Tensor;

constexpr const char* kFormat = "lightstage-training-3";

// torch keeps an optimiser's state by this key.
std::string key_of(const Tensor& parameter) {
  return c10::guts::to_string(parameter.unsafeGetTensorImpl());
}

Json to_json(const TrainingState& state) {
  Json curve = Json::array();
  for (const LossPoint& p : state.curve) curve.push_back({p.step, p.seconds, p.train, p.validation, p.level});
  return {{"step", state.step},
          {"seconds", state.seconds},
          {"loss_sum", state.loss_sum},
          {"loss_count", state.loss_count},
          {"guide_validation", state.guide_validation},
          {"first_validation", state.first_validation},
          {"best_validation", state.best_validation},
          {"curve", curve}};
}

TrainingState from_json(const Json& json) {
  TrainingState state;
  json.at("step").get_to(state.step);
  json.at("seconds").get_to(state.seconds);
  json.at("loss_sum").get_to(state.loss_sum);
  json.at("loss_count").get_to(state.loss_count);
  json.at("guide_validation").get_to(state.guide_validation);
  json.at("first_validation").get_to(state.first_validation);
  json.at("best_validation").get_to(state.best_validation);
  for (const Json& p : json.at("curve")) state.curve.push_back({p.at(0), p.at(1), p.at(2), p.at(3), p.at(4)});
  return state;
}

// "seed was 1, is 2; crop was 96, is 64"
std::string differences(const std::string& before, const std::string& now) {
  const Json parsed = Json::parse(before, nullptr, /*allow_exceptions=*/false);
  if (!parsed.is_object() || parsed.empty()) return "it does not say which it had";
  const Json was = parsed.flatten(), is = Json::parse(now).flatten();
  Json keys = was;
  keys.update(is);
  const auto value = [](const Json& settings, const std::string& key) {
    return settings.contains(key) ? settings.at(key).dump(-1, ' ', false, Json::error_handler_t::replace) : "absent";
  };
  constexpr std::size_t kMostShown = 4;
  std::size_t different = 0;
  std::string text;
  for (const auto& [key, unused] : keys.items()) {
    const std::string old_value = value(was, key), new_value = value(is, key);
    if (old_value == new_value || ++different > kMostShown) continue;
    text += (text.empty() ? "" : "; ") + key.substr(1) + " was " + old_value + ", is " + new_value;
  }
  return different <= kMostShown ? text : text + "; and " + std::to_string(different - kMostShown) + " more";
}

}  // namespace

fs::path state_path(const fs::path& checkpoint) {
  fs::path path = checkpoint;
  path += ".state";
  return path;
}

void save_state(const fs::path& path, const TrainingState& state, const std::string& fingerprint,
                const Network& network, const torch::optim::Adam& optimiser) {
  NamedTensors tensors;
  Json adam_steps = Json::object();
  for (const auto& [name, parameter] : network.parameters()) {
    tensors.emplace_back("weight/" + name, parameter);
    const auto found = optimiser.state().find(key_of(parameter));
    if (found == optimiser.state().end()) continue;  // it had no gradient yet
    const auto& moments = static_cast<const AdamState&>(*found->second);
    tensors.emplace_back("mean/" + name, moments.exp_avg());
    tensors.emplace_back("square/" + name, moments.exp_avg_sq());
    adam_steps[name] = moments.step();
  }
  Json json = to_json(state);
  json["adam_steps"] = adam_steps;
  write_tensors(path, {{"format", kFormat}, {"fingerprint", fingerprint}, {"state", json.dump()}}, tensors);
}

TrainingState load_state(const fs::path& path, const std::string& fingerprint, Network& network,
                         torch::optim::Adam& optimiser) {
  const SafetensorsHeader header = read_safetensors_header(path);
  const auto text = [&](const std::string& key) {
    const auto found = header.metadata.find(key);
    return found == header.metadata.end() ? std::string() : found->second;
  };
  if (text("format") != kFormat)
    throw core::BadInput(path.string() + ": is not the state of a training run of this version");
  if (text("fingerprint") != fingerprint) {
    throw core::BadInput(path.string() + ": belongs to a run with other settings and cannot be resumed with these: " +
                         differences(text("fingerprint"), fingerprint));
  }
  TrainingState state;
  std::map<std::string, std::int64_t> adam_steps;
  try {
    const Json json = Json::parse(text("state"));
    state = from_json(json);
    json.at("adam_steps").get_to(adam_steps);
  } catch (const Json::exception&) {
    throw core::BadInput(path.string() + ": its state is damaged");
  }

  NamedTensors tensors;
  for (const auto& [name, parameter] : network.parameters()) {
    tensors.emplace_back("weight/" + name, parameter);
    const auto steps = adam_steps.find(name);
    if (steps == adam_steps.end()) continue;
    auto moments = std::make_unique<AdamState>();
    moments->step(steps->second);
    moments->exp_avg(torch::zeros_like(parameter));
    moments->exp_avg_sq(torch::zeros_like(parameter));
    tensors.emplace_back("mean/" + name, moments->exp_avg());
    tensors.emplace_back("square/" + name, moments->exp_avg_sq());
    optimiser.state()[key_of(parameter)] = std::move(moments);
  }
  read_tensors(path, header, tensors);
  return state;
}

}  // namespace lightstage::model
