#include "cli/jobs/method_options.h"

#include <algorithm>
#include <map>

#include <CLI/CLI.hpp>

#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::cli {

void add_method_options(CLI::App& command, MethodChoice& choice) {
  std::string names;
  for (const model::MethodInfo& method : model::methods()) {
    names += "\n  " + method.name + ": " + method.summary + " (" + method.citation + ")";
  }
  command.add_option("--method", choice.method,
                     "How pictures between the lights are made [superres if the scan has a model, else rbf]:" + names);
  command.add_option("--model", choice.model, "Model file or name, for superres [the newest trained on this scan]");
  command.add_option("--neighbours", choice.options.neighbours, "Lights that linear blends")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  command.add_option("--sharpness", choice.options.sharpness, "s of linear's weights [from the light spacing]")
      ->check(number_between(0.0, 1e6));
  const std::map<std::string, model::Domain> domains{{"linear", model::Domain::kLinear},
                                                     {"display", model::Domain::kDisplay}};
  command
      .add_option(
          "--domain", choice.options.domain,
          "linear and rbf: blend linear or display-encoded values [display; an environment is always summed linearly]")
      ->transform(CLI::CheckedTransformer(domains));
}

MethodChoice resolve(const MethodChoice& choice, const db::Store& store, db::Id scan_id) {
  std::vector<std::string> names;
  for (const model::MethodInfo& method : model::methods()) names.push_back(method.name);
  if (!choice.method.empty() && std::find(names.begin(), names.end(), choice.method) == names.end()) {
    throw core::UsageError("no method '" + choice.method + "'" + core::did_you_mean(choice.method, names));
  }
  MethodChoice resolved = choice;
  const bool open = choice.method.empty();
  if (open || choice.method == "superres") {
    if (const auto file = find_model(store, choice.model, scan_id)) resolved.options.model_file = *file;
  }
  if (open) resolved.method = resolved.options.model_file.empty() ? "rbf" : "superres";
  if (resolved.method == "superres" && resolved.options.model_file.empty()) {
    throw core::UsageError("no model was trained on this scan: give --model FILE, or run `lightstage train`");
  }
  return resolved;
}

}  // namespace lightstage::cli
