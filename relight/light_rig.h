// Light rigs: lights and an environment, fixed or moving along keyframes, in a TOML file. docs/relight.md describes the
// format.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "relight/area_light.h"
#include "relight/keyframes.h"

namespace lightstage::relight {

struct RigLight {
  Track<core::Direction> direction;
  Track<double> radius_degrees = 0.0;              // 0 to 180
  Track<core::Vec3> colour = core::Vec3{1, 1, 1};  // linear RGB, not negative
  Track<double> intensity = 1.0;                   // a factor on the colour

  AreaLight at(double seconds) const;
  bool is_fixed() const;
};

struct RigEnvironment {
  std::filesystem::path file;
  Track<double> rotate_degrees = 0.0;  // as Environment::rotated
  Track<double> exposure_stops = 0.0;  // the map times 2^stops
};

// An environment at one time.
struct PlacedEnvironment {
  std::filesystem::path file;
  double rotate_degrees = 0, exposure_stops = 0;

  friend bool operator==(const PlacedEnvironment&, const PlacedEnvironment&) = default;
};

// The light of one frame. Which lights are fixed is the same for all frames of a rig: a picture under those serves for all.
struct RigFrame {
  std::vector<AreaLight> fixed, moving;
  std::optional<PlacedEnvironment> environment;
};

struct LightRig {
  std::vector<RigLight> lights;
  std::optional<RigEnvironment> environment;
  int frames = 1;
  double frames_per_second = 24;

  // Throws BadInput with file, line and key for a file that is not as docs/relight.md says. The environment's path is taken from
  // the rig's folder; the environment itself is not looked at.
  static LightRig read(const std::filesystem::path& path);
  // `source_name` stands for the file name in messages.
  static LightRig parse(std::string_view text, const std::string& source_name, const std::filesystem::path& folder);

  // The light at index / frames_per_second seconds.
  RigFrame frame(int index) const;
};

}  // namespace lightstage::relight
