// `calibrate verify`: whether a stage's calibration still holds.
#pragma once

#include <CLI/App.hpp>

namespace lightstage::cli {

class Context;

void add_calibrate_verify(CLI::App& calibrate, Context& context);

}  // namespace lightstage::cli
