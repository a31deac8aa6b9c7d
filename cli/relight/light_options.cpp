#include "cli/relight/light_options.h"

#include <algorithm>
#include <set>

#include <CLI/CLI.hpp>

#include "cli/options.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

constexpr double kBrightest = 1e6;

// The i-th light's value of an option that stands once for all lights or once for each.
const std::string* value_of(const std::vector<std::string>& values, std::size_t i) {
  if (values.empty()) return nullptr;
  return values.size() == 1 ? &values.front() : &values[i];
}

void require_fitting(const char* option, std::size_t given, std::size_t lights) {
  if (given <= 1 || given == lights) return;
  throw core::UsageError(std::string(option) + " is given " + std::to_string(given) + " times for " +
                         std::to_string(lights) + (lights == 1 ? " light" : " lights") +
                         "; give it once for all lights, or once for each in their order");
}

core::Vec3 colour_option(const std::string& text) {
  std::vector<double> rgb;
  for (const std::string_view piece : core::split(text, ',')) {
    const std::optional<double> value = core::parse_number(core::trim(piece));
    if (value && *value >= 0 && *value <= kBrightest) rgb.push_back(*value);
  }
  if (rgb.size() != 3 || std::count(text.begin(), text.end(), ',') != 2)
    throw core::UsageError("--colour: '" + text + "' is not r,g,b: three linear values of 0 to " +
                           core::number_text(kBrightest));
  return {rgb[0], rgb[1], rgb[2]};
}

relight::LightRig rig_of_lights(const LightOptions& options) {
  require_fitting("--radius", options.radii.size(), options.lights.size());
  require_fitting("--colour", options.colours.size(), options.lights.size());
  relight::LightRig rig;
  for (std::size_t i = 0; i < options.lights.size(); ++i) {
    relight::RigLight light{.direction = direction_option("--light", options.lights[i])};
    if (const std::string* radius = value_of(options.radii, i)) light.radius_degrees = *core::parse_number(*radius);
    if (const std::string* colour = value_of(options.colours, i)) light.colour = colour_option(*colour);
    rig.lights.push_back(std::move(light));
  }
  return rig;
}

// The next frame would stand where the first one does.
relight::LightRig turning(const std::filesystem::path& file, double start_degrees, int frames) {
  relight::LightRig rig;
  rig.frames = frames;
  rig.environment = relight::RigEnvironment{.file = file, .rotate_degrees = start_degrees};
  rig.frames_per_second = 1;
  if (frames > 1)
    rig.environment->rotate_degrees =
        relight::Track<double>({{0, start_degrees}, {double(frames), start_degrees + 360}});
  return rig;
}

}  // namespace

void add_light_options(CLI::App& command, LightOptions& options) {
  const auto repeated = [](CLI::Option* option) {
    return option->allow_extra_args(false)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  };
  CLI::Option* light = repeated(command.add_option("--light", options.lights,
                                                   "Direction to a light: x,y,z or longitude,latitude in degrees; may "
                                                   "be given several times"));
  repeated(command.add_option("--radius", options.radii,
                              "Angular radius of the lights, degrees: once for all, or once for each in their order "
                              "[0]"))
      ->needs(light)
      ->check(number_between(0.0, 180.0));
  repeated(command.add_option("--colour", options.colours,
                              "Linear r,g,b of the lights, 1 is one stage light: once for all, or once for each in "
                              "their order [1,1,1]"))
      ->needs(light);
  CLI::Option* environment =
      repeated(command.add_option("--env", options.environments,
                                  "Lat-long environment map (EXR or HDR); may be given several times, for a picture "
                                  "under each"));
  command.add_option("--rotate", options.rotate_degrees, "Turn the environments about the vertical, degrees [0]")
      ->needs(environment)
      ->check(number_between(-1e6, 1e6));
  command
      .add_option("--turn", options.turn_frames,
                  "So many frames in which each environment turns round once, from where --rotate puts it")
      ->needs(environment)
      ->check(CLI::Range(1, 1000000));
  CLI::Option* rig = command.add_option("--rig", options.rig,
                                        "Lights and environment from a TOML file, fixed or moving (docs/relight.md)");
  light->excludes(environment)->excludes(rig);
  environment->excludes(rig);
}

std::vector<Sequence> sequences(const LightOptions& options) {
  if (!options.lights.empty()) return {{"light", rig_of_lights(options)}};
  if (!options.rig.empty()) {
    Sequence sequence{options.rig.stem().string(), relight::LightRig::read(options.rig)};
    if (sequence.rig.environment) core::read_image_size(sequence.rig.environment->file);
    return {sequence};
  }
  if (options.environments.empty()) throw core::UsageError("give the light: --light x,y,z, --env FILE or --rig FILE");
  std::vector<Sequence> all;
  std::set<std::string> stems;
  for (const std::filesystem::path& file : options.environments) {
    core::read_image_size(file);
    all.push_back({file.stem().string(), turning(file, options.rotate_degrees, options.turn_frames)});
    if (!stems.insert(all.back().stem).second)
      throw core::UsageError("--env: two maps are called '" + all.back().stem +
                             "', and so would be their pictures; relight them one at a time");
  }
  return all;
}

}  // namespace lightstage::cli
