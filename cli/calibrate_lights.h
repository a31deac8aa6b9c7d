// `calibrate lights`: lights from loose pictures of balls.
#pragma once

#include <CLI/App.hpp>

namespace lightstage::cli {

class Context;

void add_calibrate_lights(CLI::App& calibrate, Context& context);

}  // namespace lightstage::cli
