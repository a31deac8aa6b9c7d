#include "cli/evaluate/choices.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "cli/jobs/scans.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/text.h"
#include "model/checkpoint.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

std::vector<std::string> split_names(const std::string& text) {
  std::vector<std::string> names;
  for (const std::string_view name : core::split(text, ',')) {
    if (!name.empty()) names.emplace_back(name);
  }
  return names;
}

// Whether a model of this origin may have been trained on the lights 0, every, 2 every, ...; what it started from counts too. What
// cannot be understood may mean anything.
bool may_have_seen(const ordered_json& provenance, int every) {
  if (!provenance.is_object()) return true;
  const auto started_from = provenance.find("start_from");
  const bool from_scratch = started_from == provenance.end() || started_from->is_null() || *started_from == "";
  if (!from_scratch) {
    if (!started_from->is_object() || may_have_seen(started_from->value("provenance", ordered_json()), every))
      return true;
  }
  const auto data = provenance.find("data");
  const bool simulated_views_alone = data != provenance.end() && data->is_object();
  if (simulated_views_alone) return false;
  const auto held_out = provenance.find("held_out_every");
  if (held_out == provenance.end() || !held_out->is_number_integer()) return true;
  const auto held_out_every = held_out->get<std::int64_t>();
  return held_out_every <= 0 || every % held_out_every != 0;
}

}  // namespace

std::vector<MethodChoice> chosen_methods(const MethodChoice& asked, const db::Store& store, db::Id scan_id) {
  std::vector<std::string> names = split_names(asked.method);
  std::map<model::Architecture, std::string> given;  // what each --model is for
  for (const std::string& file : split_names(asked.model)) {
    const auto architecture = model::read_checkpoint_info(find_model(store, file)).config.architecture;
    const auto [other, is_new] = given.emplace(architecture, file);
    if (!is_new) {
      throw core::UsageError("--model: " + other->second + " and " + file + " are both for method " +
                             std::string(model::architecture_name(architecture)));
    }
  }
  if (names.empty() || names == std::vector<std::string>{"all"}) {
    names.clear();
    for (const model::MethodInfo& method : model::methods()) {
      const auto architecture = network_of(method.name);
      if (!architecture || architecture == model::Architecture::kBlend || given.contains(*architecture) ||
          newest_model(store, scan_id, {.architecture = architecture})) {
        names.push_back(method.name);
      } else {
        core::note(method.name + " is left out: no model of it was trained on this scan (give --model)");
      }
    }
  }
  for (const auto& [architecture, file] : given) {
    const std::string name(model::architecture_name(architecture));
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw core::UsageError(file + " is a model for --method " + name + ", which is not among the methods");
    }
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (std::find(names.begin(), names.begin() + std::ptrdiff_t(i), names[i]) != names.begin() + std::ptrdiff_t(i))
      throw core::UsageError("--method names " + names[i] + " twice");
  }
  refuse_useless_knobs(asked, names);
  std::vector<MethodChoice> choices;
  for (const std::string& name : names) {
    MethodChoice choice = for_method(asked, name);
    const auto architecture = network_of(name);
    choice.model = architecture && given.contains(*architecture) ? given.at(*architecture) : "";
    choices.push_back(resolve(choice, store, scan_id));
  }
  return choices;
}

void warn_if_seen_in_training(std::span<const MethodChoice> choices, int every) {
  for (const MethodChoice& choice : choices) {
    if (choice.options.model_file.empty()) continue;
    const std::string provenance = model::read_checkpoint_info(choice.options.model_file).provenance;
    if (may_have_seen(ordered_json::parse(provenance, nullptr, false), every)) {
      const std::string remedy = every == 1 ? "train with --hold-out-every N and evaluate with --every N, N from 2"
                                            : "train with --hold-out-every " + std::to_string(every);
      core::warn(choice.method + " may have been trained on the lights held out here: its errors are flattered; " +
                 remedy);
    }
  }
}

}  // namespace lightstage::cli
