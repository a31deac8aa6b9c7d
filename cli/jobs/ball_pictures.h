// Loose pictures of balls, one a light, as a folder and a TOML file describe them.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/jobs/join_lights.h"
#include "core/image.h"
#include "core/image_file.h"

namespace lightstage::cli {

// In one folder of pictures.
struct BallInPictures : SeenBall {
  std::filesystem::path folder;
  double light_distance = calib::kFarInRadii;  // of the lights from the stage's centre, in the camera's lengths
};

// The lights' pictures have the same names in every folder.
struct BallPictures {
  std::vector<std::string> names;  // one a light, numbers in them in numerical order
  std::vector<BallInPictures> views;
  std::optional<std::filesystem::path> dark;  // in every folder
  core::Encoding encoding = core::Encoding::kAuto;
  double saturation = 1;  // stored value at which the sensor clips, linear; 0: not known, by default so for float files
  bool metric = false;    // cameras and balls are in metres
  std::optional<double> stage_radius_m;  // distance of the lights from the stage's centre, where known
  double stage_radius_sigma_m = 0;       // how far single lights are off it
};

// Where the balls are: as `description` says (circles, or pictures that show their outlines), or with `detect` in the mean of the lights'
// pictures where it does not say. Without a description: one ball, nothing known of the camera. docs/calibration.md has every key.
// Throws BadInput for what does not fit together: names with file and key what is missing or misspelt.
BallPictures find_balls(const std::filesystem::path& folder, const std::optional<std::filesystem::path>& description,
                        bool detect);

// The light's picture as that view's camera saw it, less the dark picture.
core::Image load_picture(const BallPictures& pictures, const BallInPictures& view, std::size_t light);

}  // namespace lightstage::cli
