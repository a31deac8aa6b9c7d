// `calibrate cameras` and `calibrate board`.
#pragma once

#include <CLI/CLI.hpp>

#include "cli/context.h"

namespace lightstage::cli {

void add_calibrate_cameras(CLI::App& calibrate, Context& context);
void add_calibrate_board(CLI::App& calibrate, Context& context);

}  // namespace lightstage::cli
