#pragma once

#include "cli/context.h"

namespace CLI {
class App;
}

namespace lightstage::cli {

// `bench align`.
void add_bench_align(CLI::App& bench, Context& context);

}  // namespace lightstage::cli
