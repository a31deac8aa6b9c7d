#include "cli/relight/make_pictures.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/file.h"
#include "core/interrupt.h"
#include "core/progress.h"

namespace lightstage::cli {

namespace {

// Half floats, which files hold, reach from 2^-14 (below it they lose digits) to 65504.
void look_at_range(const core::Image& picture, const std::filesystem::path& file) {
  constexpr float kMost = 65504, kLeast = 0x1p-14F;
  const auto values = picture.values();
  if (!std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); }))
    throw core::BadInput(file.string() + ": the light is too bright for a picture of it; make it dimmer");
  const float largest = *std::max_element(values.begin(), values.end());
  if (largest > kMost)
    core::warn(file.string() + ": the light is so bright that values above 65504 are cut off there; make it dimmer");
  if (largest > 0 && largest < kLeast)
    core::warn(file.string() + ": the light is so dim that digits are lost; make it brighter");
}

}  // namespace

void find_made_pictures(std::vector<PictureJob>& jobs, const PicturePlace& place, const PictureFiles& files) {
  for (PictureJob& job : jobs) {
    job.is_made.assign(std::size_t(job.sequence.rig.frames), false);
    if (!place.is_folder()) continue;
    for (int frame = 0; frame < job.sequence.rig.frames; ++frame) {
      const std::filesystem::path file = place.file(job.sequence, frame);
      const std::optional<double> stops = files.made_already(file, job.recipe.of_frame(frame));
      if (!stops) continue;
      if (job.stops.value_or(*stops) != *stops)
        throw core::UsageError(file.string() +
                               ": its PNG has another exposure than those before it; remove it to have "
                               "it made again, or choose another --out");
      job.stops = stops;
      job.is_made[std::size_t(frame)] = true;
    }
  }
}

std::vector<MadePicture> make_pictures(
    std::vector<PictureJob>& jobs, const PicturePlace& place, PictureFiles& files, const FrameOptions& options,
    core::ImageView mask, const std::function<std::unique_ptr<model::LightInterpolator>()>& make_interpolator) {
  std::size_t missing = 0;
  for (const PictureJob& job : jobs) missing += std::size_t(std::count(job.is_made.begin(), job.is_made.end(), false));
  std::unique_ptr<model::LightInterpolator> interpolator;
  std::optional<FramePictures> pictures;
  std::optional<core::Progress> progress;
  if (missing > 0) {
    if (place.is_folder()) core::make_folder(place.path());
    interpolator = make_interpolator();
    pictures.emplace(*interpolator, options);
  }
  if (missing > 1) progress.emplace("relighting", missing);

  std::vector<MadePicture> all;
  for (PictureJob& job : jobs) {
    for (int frame = 0; frame < job.sequence.rig.frames; ++frame) {
      const std::filesystem::path file = place.file(job.sequence, frame);
      if (job.is_made[std::size_t(frame)]) {
        all.push_back({relight::picture_files(file), *job.stops, true});
        continue;
      }
      core::throw_if_interrupted();
      FramePicture picture = pictures->picture(job.sequence.rig.frame(frame));
      look_at_range(picture.image, file);
      if (!job.stops) job.stops = relight::auto_exposure_stops(picture.image, mask);
      const auto written =
          files.write(file, picture.image, *job.stops, job.recipe.of_frame(frame), job.recipe.origin());
      picture.image = core::Image();
      all.push_back({written, *job.stops, false, std::move(picture)});
      if (progress) progress->advance();
    }
  }
  return all;
}

}  // namespace lightstage::cli
