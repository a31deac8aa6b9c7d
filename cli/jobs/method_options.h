// The options by which commands choose a method.
#pragma once

#include <memory>
#include <string>

#include "core/olat_scan.h"
#include "db/store.h"
#include "model/methods.h"

namespace CLI {
class App;
}

namespace lightstage::cli {

struct MethodChoice {
  std::string method;  // a name, or empty: superres where a model of the scan exists, else rbf
  std::string model;   // file or name
  model::MethodOptions options;
};

// Adds --method, --model, --neighbours, --sharpness and --domain.
void add_method_options(CLI::App& command, MethodChoice& choice);

// Fills in what the user left open: the model file, the method. Throws UsageError when superres has no model.
MethodChoice resolve(const MethodChoice& choice, const db::Store& store, db::Id scan_id);

}  // namespace lightstage::cli
