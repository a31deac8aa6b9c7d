#include "cli/jobs/method_options.h"

#include <algorithm>
#include <map>

#include <CLI/CLI.hpp>

#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/text.h"
#include "model/shipped_model.h"

namespace lightstage::cli {

void add_method_options(CLI::App& command, MethodChoice& choice) {
  std::string names;
  for (const model::MethodInfo& method : model::methods()) {
    names += "\n  " + method.name + ": " + method.summary + " (" + method.citation + ")";
  }
  command.add_option(
      "--method", choice.method,
      "How pictures between the lights are made [by the newest model trained on the scan that beat rbf, else blend]:" +
          names);
  command.add_option(
      "--model", choice.model,
      "Model file or name, for blend and superres [the newest trained on the scan; blend has one from the start]");
  command.add_option("--neighbours", choice.options.neighbours, "Lights that linear blends")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  command.add_option("--sharpness", choice.options.sharpness, "s of linear's weights [from the light spacing]")
      ->check(number_between(0.0, 1e6));
  command.add_flag("--bf16", choice.options.network.bfloat16,
                   "superres: multiply bfloat16 numbers; 1.7 times as fast, values within about 0.01");
  command.add_flag("--half-cache", choice.options.network.half_storage,
                   "superres: keep what the network makes of captured images in 16 bits, so that twice as much fits");
  const auto megabytes = [&](const std::string& name, std::size_t& bytes, const std::string& description) {
    command
        .add_option_function<std::size_t>(
            name, [&bytes](std::size_t value) { bytes = value << 20; }, description)
        ->check(CLI::Range(0, 1 << 24));
  };
  megabytes("--cache-mb", choice.options.network.cache_bytes,
            "superres: memory for captured images and what the network makes of each, MiB [2048]");
  megabytes("--spill-mb", choice.options.network.spill_bytes,
            "superres: temporary file for encoded images that do not fit there, MiB [0]");
  const std::map<std::string, model::Domain> domains{{"linear", model::Domain::kLinear},
                                                     {"display", model::Domain::kDisplay}};
  command
      .add_option(
          "--domain", choice.options.domain,
          "linear and rbf: blend linear or display-encoded values [display; an environment is always summed linearly]")
      ->transform(CLI::CheckedTransformer(domains));
}

MethodChoice resolve(const MethodChoice& choice, const db::Store& store, db::Id scan_id, bool adapted) {
  std::vector<std::string> names;
  for (const model::MethodInfo& method : model::methods()) names.push_back(method.name);
  if (!choice.method.empty() && std::find(names.begin(), names.end(), choice.method) == names.end()) {
    throw core::UsageError("no method '" + choice.method + "'" + core::did_you_mean(choice.method, names));
  }
  MethodChoice resolved = choice;
  std::filesystem::path& file = resolved.options.model_file;
  const std::optional<model::Architecture> architecture = network_of(choice.method);
  if (!choice.method.empty() && !architecture) {
    if (!choice.model.empty()) throw core::UsageError("--model: method " + choice.method + " is no network");
    return resolved;
  }
  if (!choice.model.empty()) {
    file = find_model(store, choice.model);
  } else {
    const ModelFilter filter{
        .architecture = architecture, .better_than_rbf = choice.method.empty(), .adapted = adapted};
    file = newest_model(store, scan_id, filter).value_or("");
    if (file.empty() && architecture != model::Architecture::kSuperres) file = model::shipped_blend();
  }
  if (choice.method.empty()) {
    resolved.method =
        file.empty() ? "rbf" : model::architecture_name(model::read_checkpoint_info(file).config.architecture);
  }
  if (architecture && file.empty()) {
    throw core::UsageError("no " + choice.method +
                           " model was trained on this scan: give --model FILE, or run `lightstage train`");
  }
  return resolved;
}

std::optional<model::Architecture> network_of(const std::string& method) {
  for (const auto architecture : {model::Architecture::kSuperres, model::Architecture::kBlend}) {
    if (method == model::architecture_name(architecture)) return architecture;
  }
  return std::nullopt;
}

}  // namespace lightstage::cli
