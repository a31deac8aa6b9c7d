#include "cli/relight/make_pictures.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "cli/relight/watched_synthesis.h"
#include "core/error.h"
#include "core/file.h"
#include "core/interrupt.h"
#include "core/progress.h"

namespace lightstage::cli {

namespace {

// How many pictures a method without linear weights synthesises for the lights of a frame; 0, not known, where it has an environment.
std::size_t pictures_for(const relight::RigFrame& frame, const std::optional<int>& samples,
                         const model::LightInterpolator& method) {
  if (frame.environment) return 0;
  std::size_t count = 0;
  for (const auto* lights : {&frame.fixed, &frame.moving}) {
    for (const relight::AreaLight& light : *lights) {
      const bool is_point = light.radius_degrees == 0;
      count += is_point ? 1 : std::size_t(samples ? *samples : relight::area_samples(method, light.radius_degrees));
    }
  }
  return count;
}

// What is told while pictures are made: of several how many are finished, and of each what is synthesised for it.
class Telling {
 public:
  explicit Telling(std::size_t pictures) : pictures_(pictures) {
    if (pictures_ > 1) progress_.emplace("relighting", pictures_);
  }

  void begin(std::size_t to_synthesise) {
    synthesised_ = 0;
    to_synthesise_ = to_synthesise;
  }

  void synthesised() {
    const std::size_t count = ++synthesised_;
    if (pictures_ > 1) {
      progress_->set_status(std::to_string(count) +
                            (to_synthesise_ > 0 ? " of " + std::to_string(to_synthesise_) : "") +
                            " synthesised for the next");
    } else if (to_synthesise_ != 1) {
      if (!progress_) progress_.emplace("synthesising pictures", to_synthesise_);
      progress_->advance();
    }
  }

  void finished() {
    if (pictures_ < 2) return;
    progress_->set_status("");
    progress_->advance();
  }

 private:
  std::size_t pictures_, to_synthesise_ = 0;
  std::atomic<std::size_t> synthesised_ = 0;
  std::optional<core::Progress> progress_;
};

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
  std::optional<WatchedSynthesis> watched;
  std::optional<FramePictures> pictures;
  Telling telling(missing);
  if (missing > 0) {
    if (place.is_folder()) core::make_folder(place.path());
    interpolator = make_interpolator();
    watched.emplace(*interpolator, [&telling] { telling.synthesised(); });
    pictures.emplace(*watched, options);
  }

  std::vector<MadePicture> all;
  for (PictureJob& job : jobs) {
    for (int frame = 0; frame < job.sequence.rig.frames; ++frame) {
      const std::filesystem::path file = place.file(job.sequence, frame);
      if (job.is_made[std::size_t(frame)]) {
        all.push_back({relight::picture_files(file), *job.stops, true});
        continue;
      }
      core::throw_if_interrupted();
      const relight::RigFrame lights = job.sequence.rig.frame(frame);
      telling.begin(pictures_for(lights, options.samples, *interpolator));
      FramePicture picture = pictures->picture(lights);
      look_at_range(picture.image, file);
      if (!job.stops) job.stops = relight::auto_exposure_stops(picture.image, mask);
      const auto written =
          files.write(file, picture.image, *job.stops, job.recipe.of_frame(frame), job.recipe.origin());
      picture.image = core::Image();
      all.push_back({written, *job.stops, false, std::move(picture)});
      telling.finished();
    }
  }
  return all;
}

}  // namespace lightstage::cli
