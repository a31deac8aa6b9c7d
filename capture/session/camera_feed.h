// One camera's frames, told apart: this exposure's, and everything else that a driver may deliver.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "capture/devices.h"

namespace lightstage::capture {

// Remembers the highest sequence number seen, so that a frame is handed on at most once.
class CameraFeed {
 public:
  explicit CameraFeed(Camera& camera) : camera_(&camera), name_(camera.name()), size_(camera.frame_size()) {}

  const std::string& name() const { return name_; }

  // These ask the camera only when something changes, or was forgotten.
  void set_exposure(core::Nanoseconds exposure);
  void set_exposing(Exposing exposing);
  // After a failure of the camera: both are set anew when they are asked for.
  void forget();

  // Throws away what is queued now; how many frames that was. Throws DeviceError when they never end (a
  // camera that runs free).
  std::size_t flush(core::Nanoseconds now);

  // The oldest frame of those that have come or come until `deadline`, whatever it is.
  std::optional<CameraFrame> next(core::Nanoseconds deadline);
  // The highest sequence number seen of frames that were not damaged.
  std::optional<std::int64_t> last_number() const { return last_sequence_number_; }
  // Of the largest picture seen; 0 before the first.
  std::size_t picture_bytes() const { return picture_bytes_; }
  // As the camera's; DeviceError for a time that no camera needs: whoever waited for it would wait for ever.
  core::Nanoseconds frame_period() const;

  struct Result {
    std::optional<CameraFrame> frame;
    bool damaged = false;       // the exposure's frame came but is useless: waiting longer is of no use
    std::size_t discarded = 0;  // duplicated, stale and damaged ones
  };
  // The frame of the exposure triggered at `trigger_time`: one that begins no earlier and whose sequence
  // number is new. Nothing when none came before `deadline`. Throws DeviceError as flush.
  Result receive(core::Nanoseconds trigger_time, core::Nanoseconds deadline);

 private:
  // The oldest frame; one of another size than the camera's is damaged.
  std::optional<CameraFrame> fetch(core::Nanoseconds deadline);
  // Takes note of the frame's number; true when it is higher than all before.
  bool note(const CameraFrame& frame);
  void check_count(std::size_t unasked) const;

  Camera* camera_;
  std::string name_;
  std::optional<core::ImageSize> size_;
  std::optional<core::Nanoseconds> exposure_;
  std::optional<Exposing> exposing_;
  std::optional<std::int64_t> last_sequence_number_;
  std::size_t picture_bytes_ = 0;
};

}  // namespace lightstage::capture
