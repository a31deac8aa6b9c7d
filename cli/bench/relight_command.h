#pragma once

#include "cli/context.h"

namespace CLI {
class App;
}

namespace lightstage::cli {

// `bench relight`.
void add_bench_relight(CLI::App& bench, Context& context);

}  // namespace lightstage::cli
