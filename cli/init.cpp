#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"

namespace lightstage::cli {

void add_init(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("init", "Make an empty store");
  command->footer("Example:\n  lightstage init --store scans");
  command->callback([&context] {
    const db::Store store = db::Store::create(context.store_folder);
    context.result("made an empty store in " + store.folder().string() + "\n", {{"store", store.folder().string()}});
  });
}

}  // namespace lightstage::cli
