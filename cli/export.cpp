#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

void add_export(CLI::App& program, Context& context) {
  CLI::App* command =
      program.add_subcommand("export", "Write a scan as a folder of EXR pictures with an .lp file, for other programs");
  command->footer("Example:\n  lightstage export head --out head-lp");
  struct Options {
    std::string name;
    std::filesystem::path out;
  };
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  command->add_option("--out", options->out, "Folder to write; new or empty")->required();
  command->callback([options, &context] {
    const db::Store store = context.open_store();
    db::export_lp(store, options->name, options->out);
    context.result("wrote " + options->out.string() + "\n",
                   {{"scan", options->name}, {"folder", options->out.string()}});
  });
}

}  // namespace lightstage::cli
