// Training on scans of a store.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "db/store.h"
#include "model/training.h"

namespace lightstage::cli {

// As model::train, on these scans without lights 0, n, 2n, ... for n = options.held_out_every, which a later `evaluate --held-out --every n`
// asks for. The model becomes a product of the scans, so that commands find it. Throws as model::train, and StoreError at once for a store that
// takes no products.
model::TrainReport train_on_scans(db::Store& store, const std::vector<std::string>& scans,
                                  const model::TrainOptions& options, const std::filesystem::path& out);

}  // namespace lightstage::cli
