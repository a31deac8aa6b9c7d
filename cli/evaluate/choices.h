// Which methods an evaluation judges.
#pragma once

#include <span>
#include <vector>

#include "cli/jobs/method_options.h"
#include "db/store.h"

namespace lightstage::cli {

// The methods that are asked for by names separated by commas, each with its own of the model files; without a name, or for `all`, all that can
// run: networks but blend only where there is a model. UsageError for a name that does not exist or stands there twice, a model or knob that none of them has, and two
// models for one network.
std::vector<MethodChoice> chosen_methods(const MethodChoice& asked, const db::Store& store, db::Id scan_id);

// Warns of networks that may have been trained on the lights 0, every, 2 every, ..., which are held out now: they would be flattered.
void warn_if_seen_in_training(std::span<const MethodChoice> choices, int every);

}  // namespace lightstage::cli
