#pragma once

#include "cli/context.h"

namespace CLI {
class App;
}

namespace lightstage::cli {

// `bench store`.
void add_bench_store(CLI::App& bench, Context& context);

}  // namespace lightstage::cli
