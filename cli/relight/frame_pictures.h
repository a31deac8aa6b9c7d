// One picture after the other under the frames of light rigs.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/relight/environment_options.h"
#include "core/image.h"
#include "model/interpolator.h"
#include "relight/light_rig.h"
#include "relight/relight.h"

namespace lightstage::cli {

struct FrameOptions {
  std::optional<int> samples;  // of every area light; as many as it needs otherwise
  EnvironmentOptions environment;
};

// A frame's picture, and what it took.
struct FramePicture {
  core::Image image;  // linear radiance
  std::size_t directions_synthesised = 0;
  double seconds = 0;
  // Of its environment, if it has one, without the picture; of the frame for which that was made, where it serves several.
  std::optional<relight::EnvironmentReport> environment;
};

// Light adds up, so a frame is the sum of up to three pictures: under its environment, its fixed and its moving
// lights. The first two are kept for the next frame, where the same ones shine. What is kept does not change the result: a
// frame's picture is bit-equal whichever were made before. Memory: one environment map, three pictures.
class FramePictures {
 public:
  // `interpolator` must outlive this.
  FramePictures(const model::LightInterpolator& interpolator, FrameOptions options);

  // The numbers count what was done for this frame. Throws as relight/relight.h, Environment::read and EnvironmentRelighter::relight.
  FramePicture picture(const relight::RigFrame& frame);

 private:
  const core::Image& under_environment(const relight::PlacedEnvironment& placed, FramePicture& frame);
  const core::Image& under_fixed_lights(const std::vector<relight::AreaLight>& lights, FramePicture& frame);
  const relight::Environment& map(const std::filesystem::path& file);

  const model::LightInterpolator& interpolator_;
  FrameOptions options_;
  std::filesystem::path map_file_;
  std::optional<relight::Environment> map_;
  std::optional<relight::EnvironmentRelighter> relighter_;  // made for the first environment
  relight::PlacedEnvironment environment_;
  core::Image environment_picture_;
  relight::EnvironmentReport environment_report_;
  std::vector<relight::AreaLight> fixed_lights_;
  core::Image fixed_picture_;
};

}  // namespace lightstage::cli
