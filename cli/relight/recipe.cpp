#include "cli/relight/recipe.h"

#include "cli/options.h"
#include "db/content_hash.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

void add(ordered_json& all, const std::vector<relight::AreaLight>& lights) {
  for (const relight::AreaLight& light : lights) {
    const core::Vec3 direction = light.direction.vec(), colour = light.irradiance;
    all.push_back({{"direction", {direction.x, direction.y, direction.z}},
                   {"radius_deg", light.radius_degrees},
                   {"colour", {colour.x, colour.y, colour.z}}});
  }
}

}  // namespace

Recipe::Recipe(relight::LightRig rig, const PictureMethod& method, const FrameOptions& options,
               std::optional<double> exposure_stops)
    : rig_(std::move(rig)) {
  common_ = {{"samples", or_null(options.samples)},
             {"exposure", exposure_stops ? ordered_json(*exposure_stops) : ordered_json("auto")}};
  common_.update(method.json());
  origin_ = {{"environment", rig_.environment ? rig_.environment->file.string() : ""},
             {"model", method.model_file().string()}};
  if (rig_.environment) {
    environment_hash_ = db::hash_file(rig_.environment->file).hex();
    common_["carried"] = options.environment.json();
  }
}

ordered_json Recipe::of_frame(int frame) const {
  const relight::RigFrame light = rig_.frame(frame);
  ordered_json lights = ordered_json::array();
  add(lights, light.fixed);
  add(lights, light.moving);
  ordered_json recipe{{"lights", lights}};
  if (light.environment)
    recipe["environment"] = {{"hash", environment_hash_},
                             {"rotate_deg", light.environment->rotate_degrees},
                             {"exposure_ev", light.environment->exposure_stops}};
  recipe.update(common_);
  return recipe;
}

}  // namespace lightstage::cli
