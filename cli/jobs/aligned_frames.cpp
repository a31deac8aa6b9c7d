#include "cli/jobs/aligned_frames.h"

#include <algorithm>
#include <optional>

#include <unistd.h>

#include "align/hidden.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"

namespace lightstage::cli {

AlignedFrames::AlignedFrames(db::Store& store, std::vector<core::Direction> lights, core::Image mask)
    : store_(store), lights_(std::move(lights)), mask_(std::move(mask)) {}

AlignedFrames::~AlignedFrames() {
  std::error_code none;
  if (!folder_.empty()) std::filesystem::remove_all(folder_, none);
}

void AlignedFrames::keep(const db::Step& step, core::ImageView picture, core::ImageView confidence) {
  const align::HiddenPixels hidden(confidence, mask_);
  hidden_ += hidden.share();
  Frame frame;
  frame.stored.step_index = step.step_index;
  frame.stored.confidence = store_.put_object(confidence);
  frame.light_index = *step.light_index;
  frame.exposure_ns = step.exposure_ns;
  if (hidden.count() == 0) {
    frame.stored.picture = store_.put_object(picture);
  } else {
    // Beside the store, whose disk has room for it: it goes there in the end.
    if (folder_.empty()) folder_ = store_.folder() / ("unfinished-alignment-" + std::to_string(getpid()));
    core::make_folder(folder_);
    frame.waiting = folder_ / (std::to_string(step.step_index) + ".exr");
    core::write_image(frame.waiting, picture);
  }
  frames_.push_back(std::move(frame));
}

core::Image AlignedFrames::picture_of(const Frame& frame) const {
  return frame.waiting.empty() ? store_.object(frame.stored.picture) : core::read_image(frame.waiting);
}

std::vector<std::size_t> AlignedFrames::beside(std::size_t place) const {
  const Frame& own = frames_[place];
  std::vector<std::size_t> others;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    if (frames_[i].exposure_ns == own.exposure_ns && i != place) others.push_back(i);
  }
  const auto angle = [&](std::size_t i) { return core::angle_radians(light_of(frames_[i]), light_of(own)); };
  const std::size_t count = std::min(align::kHiddenNeighbours, others.size());
  std::partial_sort(others.begin(), others.begin() + std::ptrdiff_t(count), others.end(),
                    [&](std::size_t a, std::size_t b) { return std::pair(angle(a), a) < std::pair(angle(b), b); });
  others.resize(count);
  return others;
}

core::Image AlignedFrames::filled(std::size_t place, core::Image& seen) const {
  const Frame& own = frames_[place];
  core::Image picture = picture_of(own);
  const core::Image confidence = store_.object(own.stored.confidence);
  align::HiddenPixels hidden(confidence, mask_);
  for (const std::size_t other : beside(place)) {
    hidden.add(picture, confidence, picture_of(frames_[other]), store_.object(frames_[other].stored.confidence), mask_,
               align::hidden_weight(light_of(own), light_of(frames_[other])));
  }
  hidden.fill(picture, seen);
  return picture;
}

std::vector<AlignedFrames::Stored> AlignedFrames::finish(core::Image& seen, std::size_t at_a_time) {
  std::vector<std::size_t> waiting;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    if (!frames_[i].waiting.empty()) waiting.push_back(i);
  }
  std::optional<core::Progress> progress;
  if (!waiting.empty()) progress.emplace("what was hidden", waiting.size());
  std::vector<db::ContentHash> objects(waiting.size());
  for (std::size_t begin = 0; begin < waiting.size(); begin += at_a_time) {
    core::throw_if_interrupted();
    const std::size_t end = std::min(waiting.size(), begin + at_a_time);
    std::vector<core::Image> pictures(end - begin), seen_by(end - begin, seen);
    core::parallel_for(end - begin, 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) pictures[i] = filled(waiting[begin + i], seen_by[i]);
    });
    for (std::size_t i = 0; i < pictures.size(); ++i) {
      objects[begin + i] = store_.put_object(pictures[i]);
      for (std::size_t p = 0; p < seen.values().size(); ++p) seen.values()[p] *= seen_by[i].values()[p];
      progress->advance();
    }
  }
  std::vector<Stored> all;
  for (std::size_t i = 0; i < waiting.size(); ++i) frames_[waiting[i]].stored.picture = objects[i];
  for (const Frame& frame : frames_) all.push_back(frame.stored);
  return all;
}

}  // namespace lightstage::cli
