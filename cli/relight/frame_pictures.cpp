#include "cli/relight/frame_pictures.h"

#include <cmath>
#include <string>
#include <utility>

#include "cli/jobs/environments.h"
#include "model/picture_sum.h"

namespace lightstage::cli {

namespace {

template <class Report>
void count(const Report& part, FramePicture& frame) {
  frame.directions_synthesised += part.directions_synthesised;
  frame.seconds += part.seconds;
}

}  // namespace

FramePictures::FramePictures(const model::LightInterpolator& interpolator, FrameOptions options)
    : interpolator_(interpolator), options_(options) {}

FramePicture FramePictures::picture(const relight::RigFrame& frame) {
  FramePicture result;
  const core::ImageSize size = interpolator_.scan().image_size();
  model::PictureSum sum({size.height, size.width, 3});
  if (frame.environment) {
    const double factor = std::exp2(frame.environment->exposure_stops);
    sum.add(under_environment(*frame.environment, result), {factor, factor, factor});
    result.environment = environment_report_;
  }
  if (!frame.fixed.empty()) sum.add(under_fixed_lights(frame.fixed, result), {1, 1, 1});
  if (!frame.moving.empty()) {
    const relight::RelightReport moving = relight::relight_area_lights(interpolator_, frame.moving, options_.samples);
    count(moving, result);
    sum.add(moving.image, {1, 1, 1});
  }
  result.image = sum.result();
  return result;
}

const core::Image& FramePictures::under_environment(const relight::PlacedEnvironment& placed, FramePicture& frame) {
  const bool known = !environment_picture_.empty() && environment_.file == placed.file &&
                     environment_.rotate_degrees == placed.rotate_degrees;
  if (known) return environment_picture_;
  const relight::Environment& whole = map(placed.file);
  if (!relighter_) relighter_.emplace(interpolator_);
  environment_report_ = relighter_->relight(placed.rotate_degrees == 0 ? whole : whole.rotated(placed.rotate_degrees),
                                            options_.environment.goal());
  count(environment_report_, frame);
  environment_ = placed;
  environment_picture_ = std::exchange(environment_report_.image, core::Image());
  return environment_picture_;
}

const core::Image& FramePictures::under_fixed_lights(const std::vector<relight::AreaLight>& lights,
                                                     FramePicture& frame) {
  if (!fixed_picture_.empty() && fixed_lights_ == lights) return fixed_picture_;
  relight::RelightReport lit = relight::relight_area_lights(interpolator_, lights, options_.samples);
  count(lit, frame);
  fixed_lights_ = lights;
  fixed_picture_ = std::move(lit.image);
  return fixed_picture_;
}

const relight::Environment& FramePictures::map(const std::filesystem::path& file) {
  if (!map_ || map_file_ != file) {
    map_ = options_.environment.resized(read_environment(file));
    map_file_ = file;
  }
  return *map_;
}

}  // namespace lightstage::cli
