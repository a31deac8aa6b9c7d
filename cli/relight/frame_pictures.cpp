#include "cli/relight/frame_pictures.h"

#include <cmath>
#include <string>

#include "core/progress.h"
#include "model/picture_sum.h"

namespace lightstage::cli {

namespace {

void count(const relight::RelightReport& part, relight::RelightReport& report) {
  report.directions_synthesised += part.directions_synthesised;
  report.seconds += part.seconds;
}

}  // namespace

FramePictures::FramePictures(const model::LightInterpolator& interpolator, FrameOptions options)
    : interpolator_(interpolator), options_(options) {}

relight::RelightReport FramePictures::picture(const relight::RigFrame& frame) {
  relight::RelightReport report;
  const core::ImageSize size = interpolator_.scan().image_size();
  model::PictureSum sum({size.height, size.width, 3});
  if (frame.environment) {
    const double factor = std::exp2(frame.environment->exposure_stops);
    sum.add(under_environment(*frame.environment, report), {factor, factor, factor});
  }
  if (!frame.fixed.empty()) sum.add(under_fixed_lights(frame.fixed, report), {1, 1, 1});
  if (!frame.moving.empty()) {
    const relight::RelightReport moving = relight::relight_area_lights(interpolator_, frame.moving, options_.samples);
    count(moving, report);
    sum.add(moving.image, {1, 1, 1});
  }
  report.image = sum.result();
  return report;
}

const core::Image& FramePictures::under_environment(const relight::PlacedEnvironment& placed,
                                                    relight::RelightReport& report) {
  const bool known = !environment_picture_.empty() && environment_.file == placed.file &&
                     environment_.rotate_degrees == placed.rotate_degrees;
  if (known) return environment_picture_;
  const relight::Environment& whole = map(placed.file);
  relight::RelightReport lit = relit(
      interpolator_, placed.rotate_degrees == 0 ? whole : whole.rotated(placed.rotate_degrees), options_.environment);
  count(lit, report);
  environment_ = placed;
  environment_picture_ = std::move(lit.image);
  return environment_picture_;
}

const core::Image& FramePictures::under_fixed_lights(const std::vector<relight::AreaLight>& lights,
                                                     relight::RelightReport& report) {
  if (!fixed_picture_.empty() && fixed_lights_ == lights) return fixed_picture_;
  relight::RelightReport lit = relight::relight_area_lights(interpolator_, lights, options_.samples);
  count(lit, report);
  fixed_lights_ = lights;
  fixed_picture_ = std::move(lit.image);
  return fixed_picture_;
}

const relight::Environment& FramePictures::map(const std::filesystem::path& file) {
  if (!map_ || map_file_ != file) {
    map_ = relight::Environment::read(file);
    map_file_ = file;
    if (map_->negative_values() > 0)
      core::warn(file.string() + ": " + std::to_string(map_->negative_values()) + " negative values count as 0");
  }
  return *map_;
}

}  // namespace lightstage::cli
