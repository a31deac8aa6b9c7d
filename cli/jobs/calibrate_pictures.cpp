#include "cli/jobs/calibrate_pictures.h"

#include <algorithm>

#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/stopwatch.h"

namespace lightstage::cli {

namespace {

// Circles drawn by hand on small balls are off by a few degrees; a stage's drawing, which would be better, there is none.
constexpr double kLargestSigmaDegrees = 5;

// The bright end of a picture, whatever few pixels are hot: its 99.9th percentile.
double bright_end(core::ImageView picture) {
  const core::Image luminance = core::to_luminance(picture);
  return core::quantile(luminance.values(), 0.999);
}

}  // namespace

PicturesReport calibrate_pictures(const BallPictures& pictures) {
  constexpr double kDeadShare = 0.01;
  const core::Stopwatch watch;
  std::vector<SeenLight> lights(pictures.names.size());
  std::vector<float> brightness(pictures.names.size(), 0);
  core::Progress progress("highlights", pictures.names.size());
  core::parallel_for(pictures.names.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      core::throw_if_interrupted();
      SeenLight& light = lights[i];
      light.index = static_cast<int>(i);
      const BallInPictures* loaded = nullptr;
      calib::BallPicture picture{light.index, {}, pictures.saturation};
      for (const BallInPictures& view : pictures.views) {
        if (loaded == nullptr || loaded->folder != view.folder) {
          picture.image = load_picture(pictures, view, i);
          brightness[i] = std::max(brightness[i], float(bright_end(picture.image)));
          loaded = &view;
        }
        light.per_view.push_back(
            calib::estimate_light(picture, view.model, view.sphere, view.light_distance, kLargestSigmaDegrees));
      }
      progress.advance();
    }
  });
  const double usual = core::quantile(brightness, 0.5);
  for (std::size_t i = 0; i < lights.size(); ++i) {
    lights[i].when_unseen = brightness[i] <= kDeadShare * usual
                                ? "dead: its picture is dark"
                                : "hidden: its picture is lit, but no highlight on the ball";
  }

  JoinOptions options{.metric = pictures.metric, .distances = {}, .largest_sigma_degrees = kLargestSigmaDegrees};
  if (pictures.stage_radius_m) {
    for (const SeenLight& light : lights) {
      options.distances[light.index] = {*pictures.stage_radius_m, pictures.stage_radius_sigma_m};
    }
  }
  const std::vector<SeenBall> views(pictures.views.begin(), pictures.views.end());
  PicturesReport report{join_lights(views, std::move(lights), options), 0};
  report.seconds = watch.seconds();
  return report;
}

}  // namespace lightstage::cli
