// `lightstage bench calib`.
#pragma once

#include <CLI/CLI.hpp>

#include "cli/context.h"

namespace lightstage::cli {

void add_bench_calib(CLI::App& bench, Context& context);

}  // namespace lightstage::cli
