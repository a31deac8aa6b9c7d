// `calibrate colour`: a camera's colours from a colour chart.
#pragma once

#include <CLI/App.hpp>

namespace lightstage::cli {

class Context;

void add_calibrate_colour(CLI::App& calibrate, Context& context);

}  // namespace lightstage::cli
