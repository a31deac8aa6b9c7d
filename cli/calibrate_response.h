// `calibrate response`: a camera's response from a stack of exposures.
#pragma once

#include <CLI/App.hpp>

namespace lightstage::cli {

class Context;

void add_calibrate_response(CLI::App& calibrate, Context& context);

}  // namespace lightstage::cli
