#include "cli/jobs/method_options.h"

#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/jobs/scans.h"
#include "core/error.h"
#include "core/text.h"
#include "model/shipped_model.h"

namespace lightstage::cli {

namespace {

// The methods that have a knob, by name.
std::vector<std::string> methods_with(const std::string& option) {
  std::vector<std::string> names;
  for (const model::MethodInfo& method : model::methods()) {
    const bool has = std::any_of(method.knobs.begin(), method.knobs.end(),
                                 [&](const model::Knob& knob) { return knob.option == option; });
    if (has) names.push_back(method.name);
  }
  return names;
}

void add_knob(CLI::App& command, MethodChoice& choice, const model::Knob& knob) {
  const std::string help =
      core::joined(methods_with(knob.option), ", ") + ": " + knob.what + " [" + knob.default_value + "]";
  if (!knob.set) {
    command.add_option(knob.option, choice.model, help);
    return;
  }
  const auto set = [&choice, &knob](const std::string& text) {
    knob.set(choice.options, text);
    choice.knobs[knob.option] = text;
  };
  if (knob.flag) {
    command.add_flag_callback(
        knob.option, [set] { set("on"); }, help);
  } else {
    command.add_option_function<std::string>(knob.option, set, help)->type_name(knob.values);
  }
}

bool has(const std::string& method, const std::string& option) {
  const std::vector<std::string> names = methods_with(option);
  return std::find(names.begin(), names.end(), method) != names.end();
}

}  // namespace

void add_method_options(CLI::App& command, MethodChoice& choice, const std::string& method_help) {
  std::string list;
  for (const model::MethodInfo& method : model::methods())
    list += "\n  " + method.name + ": " + method.summary + " (" + method.citation + ")";
  command.add_option("--method", choice.method, method_help + ":" + list);
  std::vector<std::string> added;
  for (const model::MethodInfo& method : model::methods()) {
    for (const model::Knob& knob : method.knobs) {
      if (std::find(added.begin(), added.end(), knob.option) != added.end()) continue;
      added.push_back(knob.option);
      add_knob(command, choice, knob);
    }
  }
}

void refuse_useless_knobs(const MethodChoice& choice, std::span<const std::string> methods) {
  std::vector<std::string> given;
  if (!choice.model.empty()) given.push_back("--model");
  for (const auto& [option, text] : choice.knobs) given.push_back(option);
  for (const std::string& option : given) {
    if (std::none_of(methods.begin(), methods.end(), [&](const std::string& method) { return has(method, option); })) {
      throw core::UsageError(option + " is a knob of " + core::joined(methods_with(option), ", ") + ", not of " +
                             core::joined(methods, ", ") + "; see `lightstage methods`");
    }
  }
}

MethodChoice for_method(const MethodChoice& choice, const std::string& method) {
  MethodChoice its = choice;
  its.method = method;
  if (!has(method, "--model")) its.model.clear();
  std::erase_if(its.knobs, [&](const auto& knob) { return !has(method, knob.first); });
  return its;
}

nlohmann::ordered_json knob_values(const MethodChoice& choice) {
  nlohmann::ordered_json values = nlohmann::ordered_json::object();
  for (const model::Knob& knob : model::method_info(choice.method).knobs) {
    if (!knob.set) continue;
    const auto given = choice.knobs.find(knob.option);
    values[knob.option.substr(2)] = given != choice.knobs.end() ? given->second : knob.default_value;
  }
  return values;
}

MethodChoice resolve(const MethodChoice& asked, const db::Store& store, db::Id scan_id, bool adapted) {
  MethodChoice choice = asked;
  if (choice.method == "auto") choice.method.clear();
  if (!choice.method.empty()) {
    model::method_info(choice.method);
    refuse_useless_knobs(choice, std::vector{choice.method});
  }
  MethodChoice resolved = choice;
  std::filesystem::path& file = resolved.options.model_file;
  const std::optional<model::Architecture> architecture = network_of(choice.method);
  if (!choice.method.empty() && !architecture) return resolved;
  if (!choice.model.empty()) {
    file = find_model(store, choice.model);
  } else {
    const ModelFilter filter{
        .architecture = architecture, .better_than_rbf = choice.method.empty(), .adapted = adapted};
    file = newest_model(store, scan_id, filter).value_or("");
    if (file.empty() && architecture.value_or(model::Architecture::kBlend) == model::Architecture::kBlend) {
      file = model::shipped_blend();
    }
  }
  if (choice.method.empty()) {
    resolved.method =
        file.empty() ? "rbf" : model::architecture_name(model::read_checkpoint_info(file).config.architecture);
    refuse_useless_knobs(resolved, std::vector{resolved.method});
  }
  if (architecture && file.empty()) {
    throw core::UsageError("no " + choice.method +
                           " model was trained on this scan: give --model FILE, or run `lightstage train`");
  }
  return resolved;
}

std::optional<model::Architecture> network_of(const std::string& method) {
  for (const auto architecture : model::kArchitectures) {
    if (method == model::architecture_name(architecture)) return architecture;
  }
  return std::nullopt;
}

}  // namespace lightstage::cli
