#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/jobs/export_views.h"
#include "core/error.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string name, format = "lp";
  std::filesystem::path out;
  ExportViewsOptions views;
};

void run_export(const Options& options, const Context& context) {
  const db::Store store = context.open_store();
  if (options.format == "lp") {
    if (options.views.undistort || options.views.light_index) {
      throw core::UsageError("--undistort and --light: only with --format colmap or transforms");
    }
    db::export_lp(store, options.name, options.out);
  } else {
    ExportViewsOptions views = options.views;
    views.format = options.format == "colmap" ? ViewFormat::kColmap : ViewFormat::kTransforms;
    export_views(store, options.name, options.out, views);
  }
  context.result("wrote " + options.out.string() + "\n",
                 {{"scan", options.name}, {"format", options.format}, {"folder", options.out.string()}});
}

}  // namespace

void add_export(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("export", "Write a scan as a folder for other programs");
  command->footer(
      "lp: EXR pictures with an .lp file. colmap: COLMAP's text model of the cameras and a picture of each. "
      "transforms: the\n"
      "same as transforms.json (instant-ngp, nerfstudio).\n"
      "Examples:\n"
      "  lightstage export head --out head-lp\n"
      "  lightstage export head --format colmap --undistort --out head-colmap");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  command->add_option("--out", options->out, "Folder to write; new or empty")->required();
  command->add_option("--format", options->format, "lp, colmap or transforms")
      ->capture_default_str()
      ->check(CLI::IsMember({"lp", "colmap", "transforms"}));
  command->add_flag("--undistort", options->views.undistort,
                    "Pictures as pinhole cameras would have taken them, with masks");
  command->add_option("--light", options->views.light_index, "The frame under this light [the key frame, under all]")
      ->check(CLI::NonNegativeNumber);
  command->callback([options, &context] { run_export(*options, context); });
}

}  // namespace lightstage::cli
