#include <algorithm>
#include <map>

#include "capture/light_check.h"
#include "core/error.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kDarkEvery = 20, kDarkAtStart = 3;

core::Image small_picture(const core::Image& frame) {
  const int longest = std::max(frame.height(), frame.width());
  const core::Image small = core::shrink_by_box(frame, (longest - 1) / kCheckPictureSide + 1);
  const auto channels = static_cast<std::size_t>(small.channels());
  core::Image mean(small.height(), small.width(), 1);
  for (std::size_t p = 0; p < mean.values().size(); ++p) {
    double sum = 0;
    for (std::size_t c = 0; c < channels; ++c) sum += static_cast<double>(small.values()[p * channels + c]);
    mean.values()[p] = static_cast<float>(sum / static_cast<double>(channels));
  }
  return mean;
}

void subtract(core::Image& image, const core::Image& other) {
  if (image.size() != other.size()) throw core::DeviceError("light check: a camera changed the size of its frames");
  for (std::size_t p = 0; p < image.values().size(); ++p) image.values()[p] -= other.values()[p];
}

core::Image mean_of(const std::vector<core::Image>& images) {
  const std::vector<core::ImageView> views(images.begin(), images.end());
  return core::weighted_sum(views, std::vector<double>(views.size(), 1 / static_cast<double>(views.size())));
}

}  // namespace

Sequence make_light_check_sequence(std::size_t light_count, core::Nanoseconds exposure) {
  OlatOptions olat;
  olat.light_count = light_count;
  olat.tracking_every = 0;
  olat.dark_frames = 0;
  olat.full_on = false;
  olat.exposure = exposure;
  Sequence sequence = make_olat_sequence(olat);
  const std::vector<db::Step> lights = std::move(sequence.steps);
  sequence.steps.clear();
  const auto add = [&](db::Step step, std::size_t times = 1) {
    for (; times > 0; --times) {
      step.step_index = static_cast<int>(sequence.steps.size());
      sequence.steps.push_back(step);
    }
  };
  db::Step dark;
  dark.kind = db::StepKind::kDark;
  dark.exposure_ns = exposure;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    if (i % kDarkEvery == 0) add(dark, i == 0 ? kDarkAtStart : 1);
    add(lights[i]);
  }
  add(dark);
  return sequence;
}

std::vector<CameraPictures> take_light_pictures(const Sequence& sequence, const Rig& rig,
                                                const SessionOptions& options) {
  const auto is_dark = [](const db::Step& step) { return step.kind == db::StepKind::kDark; };
  if (std::none_of(sequence.steps.begin(), sequence.steps.end(), is_dark)) {
    throw core::UsageError("light check: the sequence has no dark frame to compare with");
  }
  std::vector<CameraPictures> cameras;
  std::map<std::string, std::size_t> index_of;
  for (const Camera* camera : rig.cameras) {
    index_of[camera->name()] = cameras.size();
    cameras.push_back({camera->name(), std::vector<core::Image>(rig.lights.light_count()), {}});
  }
  SessionOptions reducing = options;
  reducing.on_frame = [&](const db::Step& step, const std::string& camera, const CameraFrame& frame) {
    CameraPictures& pictures = cameras[index_of.at(camera)];
    if (step.kind == db::StepKind::kLight) {
      pictures.of_light[static_cast<std::size_t>(*step.light_index)] = small_picture(frame.image);
    } else if (is_dark(step)) {
      pictures.dark.push_back(small_picture(frame.image));
    }
    if (options.on_frame) options.on_frame(step, camera, frame);
  };
  dry_run(sequence, rig, reducing);
  for (CameraPictures& camera : cameras) {
    const core::Image dark = mean_of(camera.dark);
    for (core::Image& picture : camera.dark) subtract(picture, dark);
    for (core::Image& picture : camera.of_light) {
      if (!picture.empty()) subtract(picture, dark);
    }
  }
  return cameras;
}

}  // namespace lightstage::capture
