// The device interfaces: what a back end (simulated, USB, V4L2, GPIO) must do. All throw core::DeviceError
// naming the device.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "capture/sequence.h"
#include "core/clock.h"
#include "core/image.h"

namespace lightstage::capture {

// What a controller tells of itself; a value that it does not measure is empty.
struct LedStatus {
  std::optional<double> temperature_celsius;  // of the hottest board
  std::optional<double> supply_volts;
  std::vector<std::string> faults;  // one line each; empty: none
};

// A controller that holds a whole sequence and steps through it by itself, at the end of every pulse on its strobe
// input. Wire the strobe output of a camera to it: each exposure then lights the next pattern without the host.
class PatternPlayer {
 public:
  virtual ~PatternPlayer() = default;
  // Replaces what was loaded. Lights nothing.
  virtual void load(std::span<const std::vector<LightLevel>> patterns) = 0;
  // Lights pattern `first` of those loaded. Every strobe pulse from now on lights the next one, `delay` after it ends (by
  // so much other cameras' exposures may end later); after the last all lights are off.
  virtual void arm(std::size_t first, core::Nanoseconds delay) = 0;
  // The pattern that is lit now, as the controller says at this moment; one past the last when all lights are off after it.
  virtual std::size_t position() = 0;
  // Waits until pattern `index` has been reached, at most until `deadline` on the session's clock. Returns a time at
  // which it was certainly lit already (all lights off, when `index` is one past the last pattern); nothing when it was
  // not reached.
  virtual std::optional<core::Nanoseconds> wait_for_pattern(std::size_t index, core::Nanoseconds deadline) = 0;
};

class LedController {
 public:
  virtual ~LedController() = default;
  virtual std::size_t light_count() const = 0;
  // Lights exactly these, all others off. Returns when the controller has acknowledged, not when the LEDs
  // have settled. Ends what a pattern player was playing.
  virtual void show(std::span<const LightLevel> levels) = 0;
  // Everything off. Tried again by callers that get an exception: it must be safe to repeat.
  virtual void all_off() = 0;
  virtual LedStatus status() { return {}; }
  // Null where the controller cannot hold a sequence. Belongs to the controller.
  virtual PatternPlayer* player() { return nullptr; }
};

struct CameraFrame {
  core::Image image;                 // linear radiance, already freed of black level; 1 or 3 channels
  double saturation = 0;             // radiance at which the sensor clips
  std::int64_t sequence_number = 0;  // counts the camera's exposures; gaps are lost frames, repeats are duplicates
  // Start of exposure on the session's clock, as the driver tells it: many stamp a frame when it arrives, so it may be
  // late by a latency that changes little from frame to frame.
  core::Nanoseconds timestamp = 0;
  bool damaged = false;  // the driver flagged it as incomplete
};

enum class Exposing { kTriggered, kFreeRunning };

class Camera {
 public:
  virtual ~Camera() = default;
  virtual std::string name() const = 0;
  // Of its pictures, where that is known; a frame of another size is damaged.
  virtual std::optional<core::ImageSize> frame_size() const { return std::nullopt; }
  // Takes effect with the next exposure. Throws when the camera cannot do it; never rounds silently.
  virtual void set_exposure(core::Nanoseconds exposure) = 0;
  // Whether exposures wait for the trigger (as after opening) or follow each other. Frames of before may still come.
  virtual void set_exposing(Exposing exposing) = 0;
  // The shortest time from the start of one exposure to the start of the next, at the exposure set; while the camera
  // runs free, the time between them.
  virtual core::Nanoseconds frame_period() const = 0;
  // The oldest frame not yet fetched; waits for one until `deadline` on the session's clock; nothing when
  // none came.
  virtual std::optional<CameraFrame> wait_frame(core::Nanoseconds deadline) = 0;
};

// Starts one exposure of every camera.
class Trigger {
 public:
  virtual ~Trigger() = default;
  // Returns a time by which every camera had been triggered; the pulse is over when this returns, which may be later.
  virtual core::Nanoseconds fire() = 0;
};

// Hears a camera's strobe output: proof that an exposure happened, before its frame has travelled.
class Strobe {
 public:
  virtual ~Strobe() = default;
  // Forgets pulses that were not asked for.
  virtual void clear() = 0;
  // When the next exposure began, on the session's clock; nothing when none had until `deadline`.
  virtual std::optional<core::Nanoseconds> wait_exposure(core::Nanoseconds deadline) = 0;
};

}  // namespace lightstage::capture
