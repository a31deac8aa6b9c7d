// `calibrate linearity`: whether a camera is linear, and its noise.
#pragma once

#include <CLI/App.hpp>

namespace lightstage::cli {

class Context;

void add_calibrate_linearity(CLI::App& calibrate, Context& context);

}  // namespace lightstage::cli
