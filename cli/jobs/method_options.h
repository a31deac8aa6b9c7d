// The options by which commands choose a method.
#pragma once

#include <memory>
#include <optional>
#include <string>

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
  model::MethodOptions options;
};

// Adds --method, --model, --neighbours, --sharpness and --domain.
void add_method_options(CLI::App& command, MethodChoice& choice);

// Fills in what the user left open: the method and, for networks, the model file. With the method left open too, a model that was no better than
// rbf is left out; with `adapted` false, one that `superres --adapt` made. Throws UsageError when superres has no model, and for a model
// given to a method that is no network.
MethodChoice resolve(const MethodChoice& choice, const db::Store& store, db::Id scan_id, bool adapted = true);

// The architecture that a method of this name uses; nothing for methods that are no networks.
std::optional<model::Architecture> network_of(const std::string& method);

}  // namespace lightstage::cli
