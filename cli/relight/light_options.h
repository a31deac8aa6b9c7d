// The light that a command line asks for.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "relight/light_rig.h"

namespace CLI {
class App;
}

namespace lightstage::cli {

struct LightOptions {
  std::vector<std::string> lights, radii, colours;
  std::vector<std::filesystem::path> environments;
  double rotate_degrees = 0;
  int turn_frames = 1;
  std::filesystem::path rig;
};

// Frames that belong together: they are shown at one exposure and named alike.
struct Sequence {
  std::string stem;  // of the files' names
  relight::LightRig rig;
};

// Adds --light, --radius, --colour, --env, --rotate, --turn and --rig.
void add_light_options(CLI::App& command, LightOptions& options);

// One sequence for each environment, or one for the lights or the rig. Throws UsageError unless light is asked for in exactly
// one way, for numbers of values that do not fit, and for environments of one name; BadInput for a file that is missing or
// no picture, or a rig that is wrong.
std::vector<Sequence> sequences(const LightOptions& options);

}  // namespace lightstage::cli
