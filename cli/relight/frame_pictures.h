// One picture after the other under the frames of light rigs.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/relight/relit.h"
#include "core/image.h"
#include "model/interpolator.h"
#include "relight/light_rig.h"
#include "relight/relight.h"

namespace lightstage::cli {

struct FrameOptions {
  std::optional<int> samples;  // of every area light; as many as it needs otherwise
  RelitOptions environment;
};

// Light adds up, so a frame is the sum of up to three pictures: under its environment, its fixed and its moving
// lights. The first two are kept for the next frame, where the same ones shine. What is kept does not change the result: a
// frame's picture is bit-equal whichever were made before. Memory: one environment map, three pictures.
class FramePictures {
 public:
  // `interpolator` must outlive this.
  FramePictures(const model::LightInterpolator& interpolator, FrameOptions options);

  // The report counts what was done for this frame. Throws as relight/relight.h and Environment::read.
  relight::RelightReport picture(const relight::RigFrame& frame);

 private:
  const core::Image& under_environment(const relight::PlacedEnvironment& placed, relight::RelightReport& report);
  const core::Image& under_fixed_lights(const std::vector<relight::AreaLight>& lights, relight::RelightReport& report);
  const relight::Environment& map(const std::filesystem::path& file);

  const model::LightInterpolator& interpolator_;
  FrameOptions options_;
  std::filesystem::path map_file_;
  std::optional<relight::Environment> map_;
  relight::PlacedEnvironment environment_;
  core::Image environment_picture_;
  std::vector<relight::AreaLight> fixed_lights_;
  core::Image fixed_picture_;
};

}  // namespace lightstage::cli
