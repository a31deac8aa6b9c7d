// Environment maps from files.
#pragma once

#include <filesystem>

#include "relight/environment.h"

namespace lightstage::cli {

// Warns of negative values. Throws as Environment::read.
relight::Environment read_environment(const std::filesystem::path& file);

}  // namespace lightstage::cli
