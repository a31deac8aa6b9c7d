// One function a subcommand: it adds the command with its options to the program and says what running it does.
#pragma once

#include "cli/context.h"

namespace CLI {
class App;
}

namespace lightstage::cli {

void add_init(CLI::App& program, Context& context);
void add_stage(CLI::App& program, Context& context);
void add_capture(CLI::App& program, Context& context);
void add_lights_off(CLI::App& program, Context& context);
void add_calibrate(CLI::App& program, Context& context);
void add_merge(CLI::App& program, Context& context);
void add_align(CLI::App& program, Context& context);
void add_import(CLI::App& program, Context& context);
void add_export(CLI::App& program, Context& context);
void add_train(CLI::App& program, Context& context);
void add_model(CLI::App& program, Context& context);
void add_superres(CLI::App& program, Context& context);
void add_relight(CLI::App& program, Context& context);
void add_normals(CLI::App& program, Context& context);
void add_sky(CLI::App& program, Context& context);
void add_analyze_env(CLI::App& program, Context& context);
void add_methods(CLI::App& program, Context& context);
void add_evaluate(CLI::App& program, Context& context);
void add_store(CLI::App& program, Context& context);
void add_doctor(CLI::App& program, Context& context);
void add_bench(CLI::App& program, Context& context);
void add_demo(CLI::App& program, Context& context);

}  // namespace lightstage::cli
