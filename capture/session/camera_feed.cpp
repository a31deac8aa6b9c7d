#include "capture/session/camera_feed.h"

#include <algorithm>

#include "core/error.h"

namespace lightstage::capture {

namespace {
// In one go; no driver's queue is longer.
constexpr std::size_t kMaxUnaskedFrames = 1000;
constexpr core::Nanoseconds kLongestPeriod = 7200 * core::kSecond;  // exposures are of an hour at most
}  // namespace

void CameraFeed::set_exposure(core::Nanoseconds exposure) {
  if (exposure_ == exposure) return;
  camera_->set_exposure(exposure);
  exposure_ = exposure;
}

void CameraFeed::set_exposing(Exposing exposing) {
  if (exposing_ == exposing) return;
  camera_->set_exposing(exposing);
  exposing_ = exposing;
}

void CameraFeed::forget() {
  exposure_.reset();
  exposing_.reset();
}

std::optional<CameraFrame> CameraFeed::fetch(core::Nanoseconds deadline) {
  std::optional<CameraFrame> frame = camera_->wait_frame(deadline);
  if (frame && size_ && frame->image.size() != *size_) frame->damaged = true;
  return frame;
}

core::Nanoseconds CameraFeed::frame_period() const {
  const core::Nanoseconds period = camera_->frame_period();
  if (period >= 0 && period <= kLongestPeriod) return period;
  throw core::DeviceError("camera '" + name_ + "' says that it takes " + std::to_string(period / core::kSecond) +
                          " s from one exposure to the next");
}

std::optional<CameraFrame> CameraFeed::next(core::Nanoseconds deadline) {
  std::optional<CameraFrame> frame = fetch(deadline);
  if (frame) note(*frame);
  return frame;
}

bool CameraFeed::note(const CameraFrame& frame) {
  picture_bytes_ = std::max(picture_bytes_, frame.image.values().size_bytes());
  if (last_sequence_number_ && frame.sequence_number <= *last_sequence_number_) return false;
  // A damaged frame's number may be damaged too: one that is far too high would turn away every frame after
  // it.
  if (!frame.damaged) last_sequence_number_ = frame.sequence_number;
  return true;
}

std::size_t CameraFeed::flush(core::Nanoseconds now) {
  std::size_t count = 0;
  while (const std::optional<CameraFrame> frame = fetch(now)) {
    note(*frame);
    check_count(++count);
  }
  return count;
}

CameraFeed::Result CameraFeed::receive(core::Nanoseconds trigger_time, core::Nanoseconds deadline) {
  Result result;
  while (std::optional<CameraFrame> frame = fetch(deadline)) {
    const bool is_this_exposure = note(*frame) && frame->timestamp >= trigger_time;
    if (is_this_exposure && !frame->damaged) {
      result.frame = std::move(frame);
      return result;
    }
    check_count(++result.discarded);
    if (is_this_exposure) {
      result.damaged = true;
      return result;
    }
  }
  return result;
}

void CameraFeed::check_count(std::size_t unasked) const {
  if (unasked <= kMaxUnaskedFrames) return;
  throw core::DeviceError("camera '" + name_ +
                          "' keeps sending frames that nobody asked for; switch it to triggered mode");
}

}  // namespace lightstage::capture
