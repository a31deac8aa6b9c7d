#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "capture/stage.h"
#include "cli/commands.h"
#include "cli/options.h"
#include "cli/seed_option.h"
#include "core/error.h"
#include "core/file.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string layout = "geodesic";
  std::filesystem::path out;
  capture::LayoutOptions stage;
  capture::StageSimulation simulation;
};

capture::Stage design_stage(const Options& options) {
  const std::string name = options.out.stem().string();
  capture::LayoutOptions layout = options.stage;
  if (options.layout == "geodesic") {
    layout.layout = capture::Layout::kGeodesic;
  } else if (options.layout == "fibonacci") {
    layout.layout = capture::Layout::kFibonacci;
  } else {
    const std::vector<std::string> layouts{"geodesic", "fibonacci"};
    if (std::filesystem::path(options.layout).extension() != ".lp") {
      throw core::UsageError("--layout: '" + options.layout + "' is neither geodesic, fibonacci nor an .lp file" +
                             core::did_you_mean(options.layout, layouts));
    }
    return capture::stage_from_lp(options.layout, layout);
  }
  return capture::make_stage(name, layout);
}

}  // namespace

void add_stage(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("stage", "Design a stage: lights and cameras, as a TOML file");
  command->footer(
      "Examples:\n"
      "  lightstage stage --layout geodesic --lights 180 --out stage.toml\n"
      "  lightstage stage --layout my_dome.lp --out stage.toml");
  auto options = std::make_shared<Options>();
  command->add_option("--layout", options->layout, "geodesic, fibonacci, or an .lp file of directions")
      ->capture_default_str();
  command->add_option("--lights", options->stage.lights, "Number of lights (an .lp file has its own)")
      ->capture_default_str()
      ->check(CLI::Range(1, 100000));
  command->add_option("--radius", options->stage.radius_m, "Distance of the lights from the centre, metres")
      ->capture_default_str()
      ->check(number_between(0.2, 100.0));
  command->add_option("--cameras", options->stage.cameras, "Number of cameras")
      ->capture_default_str()
      ->check(CLI::Range(1, 12));
  command
      ->add_option("--bottom-hole", options->stage.bottom_hole_degrees,
                   "Half-angle without lights about straight down, degrees")
      ->capture_default_str()
      ->check(number_between(0.0, 120.0));
  command
      ->add_option("--mount-error", options->simulation.mount_error_degrees,
                   "Simulation: how far lights hang from where they are drawn, degrees (standard deviation)")
      ->capture_default_str()
      ->check(number_between(0.0, 10.0));
  command
      ->add_option("--gain-spread", options->simulation.gain_spread,
                   "Simulation: relative spread of the lights' brightness and colour")
      ->capture_default_str()
      ->check(number_between(0.0, 1.0));
  command->add_option("--dead", options->simulation.dead_lights, "Simulation: lights that stay dark, by index");
  command->add_option("--seed", options->simulation.seed, "Simulation: seed of the above")
      ->capture_default_str()
      ->check(seed_number());
  command->add_option("--out", options->out, "The stage file to write")->required();
  command->callback([options, &context] {
    capture::Stage stage = design_stage(*options);
    stage.simulation = options->simulation;
    core::write_file_atomically(options->out, capture::to_toml(stage));
    const std::size_t lights = stage.light_positions.size();
    context.result("wrote " + options->out.string() + ": " + core::counted(lights, "light") + ", " +
                       core::counted(stage.cameras.size(), "camera") + "\n",
                   {{"file", options->out.string()},
                    {"lights", lights},
                    {"cameras", stage.cameras.size()},
                    {"key", capture::stage_key(stage)}});
  });
}

}  // namespace lightstage::cli
