// The options by which commands choose a method.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "core/olat_scan.h"
#include "db/store.h"
#include "model/checkpoint.h"
#include "model/methods.h"

namespace CLI {
class App;
}

namespace lightstage::cli {

struct MethodChoice {
  std::string method;  // a name, or empty: that of the newest model of the scan, else blend
  std::string model;   // file or name
  std::map<std::string, std::string>
      knobs;                     // the other options that were given, with their values' texts: {"--domain", "linear"}
  model::MethodOptions options;  // what they come to
};

// What --method takes where one picture is made.
inline constexpr const char* kOneMethod =
    "How pictures between the lights are made; auto: by the newest model trained on the scan that beat rbf, else blend "
    "[auto]";

// Adds --method and every knob of every method. `method_help` says what --method takes; a list of the methods follows.
void add_method_options(CLI::App& command, MethodChoice& choice, const std::string& method_help);

// Throws UsageError for a knob given that none of these methods has.
void refuse_useless_knobs(const MethodChoice& choice, std::span<const std::string> methods);

// The choice for one of several methods: without the knobs that it does not have.
MethodChoice for_method(const MethodChoice& choice, const std::string& method);

// The value of every knob of the method, as given or by default: {"domain": "display"}. For provenance, which names the model by its hash.
nlohmann::ordered_json knob_values(const MethodChoice& choice);

// Fills in what the user left open: the method (no name, or auto) and, for networks, the model file. With the method left open too, a model that was no better than
// rbf is left out; with `adapted` false, one that `superres --adapt` made. Throws UsageError when a network but blend has no model, and
// for a knob that the method does not have.
MethodChoice resolve(const MethodChoice& choice, const db::Store& store, db::Id scan_id, bool adapted = true);

// The architecture that a method of this name uses; nothing for methods that are no networks.
std::optional<model::Architecture> network_of(const std::string& method);

}  // namespace lightstage::cli
