// What the options of a training run come to.
#pragma once

#include <nlohmann/json.hpp>
#include <span>

#include "model/training.h"

namespace lightstage::model {

// Throws UsageError for options out of range.
void check(const TrainOptions& options);

// TrainOptions::progressive, learning_rate and active_set, or their defaults.
bool trains_progressively(const TrainOptions& options);
double learning_rate(const TrainOptions& options);
ActiveSetChoice active_set_choice(const TrainOptions& options);

// What must be equal for a run to be resumed; `data` describes what it learns from.
nlohmann::json training_settings(const nlohmann::json& data, const TrainOptions& options);
// Names, sizes and exposures: the last knows one recording of a subject from another. Reads every image.
nlohmann::json description(std::span<const core::OlatScan> scans);

}  // namespace lightstage::model
