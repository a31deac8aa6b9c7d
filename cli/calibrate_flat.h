// `calibrate flat`: the flat field of a camera.
#pragma once

#include <CLI/App.hpp>

namespace lightstage::cli {

class Context;

void add_calibrate_flat(CLI::App& calibrate, Context& context);

}  // namespace lightstage::cli
