// What decides how a frame looks, as JSON.
#pragma once

#include <optional>

#include <nlohmann/json.hpp>

#include "cli/relight/frame_pictures.h"
#include "cli/relight/picture_method.h"
#include "relight/light_rig.h"

namespace lightstage::cli {

class Recipe {
 public:
  // Hashes the files of environment and model. `exposure_stops` as asked for; nothing: by the first frame.
  Recipe(relight::LightRig rig, const PictureMethod& method, const FrameOptions& options,
         std::optional<double> exposure_stops);

  nlohmann::ordered_json of_frame(int frame) const;
  // The names of the files that the recipe has the hashes of.
  nlohmann::ordered_json origin() const { return origin_; }

 private:
  relight::LightRig rig_;
  std::string environment_hash_;
  nlohmann::ordered_json common_, origin_;
};

}  // namespace lightstage::cli
