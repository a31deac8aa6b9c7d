#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/options.h"
#include "core/image_file.h"
#include "relight/sky.h"

namespace lightstage::cli {

void add_sky(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("sky", "Write an environment map of a clear sky with a sun");
  command->footer("Example:\n  lightstage sky --sun 50,35 --out sky.exr");
  struct Options {
    std::string sun = "50,35";
    relight::SkyOptions sky;
    std::filesystem::path out;
  };
  auto options = std::make_shared<Options>();
  command->add_option("--sun", options->sun, "Where the sun stands: longitude,latitude in degrees, or x,y,z")
      ->capture_default_str();
  command->add_option("--height", options->sky.height, "Height of the map, pixels; it is twice as wide")
      ->capture_default_str()
      ->check(CLI::Range(8, 8192));
  command
      ->add_option("--sun-to-sky", options->sky.sun_to_sky,
                   "How much brighter the sun lights a surface than the sky does")
      ->capture_default_str()
      ->check(number_between(0.0, 1e6));
  command->add_option("--out", options->out, "The .exr or .hdr to write")->required();
  command->callback([options, &context] {
    options->sky.sun = direction_option("--sun", options->sun);
    // Half floats would cut off the sun of a large map.
    core::write_image(options->out, relight::clear_sky(options->sky).radiance(),
                      {.pixel_type = core::PixelType::kFloat});
    context.result("wrote " + options->out.string() + "\n", {{"file", options->out.string()}});
  });
}

}  // namespace lightstage::cli
