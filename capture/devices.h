// The device interfaces: what a back end (simulated, USB, V4L2, GPIO) must do. All throw core::DeviceError
// naming the device.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "capture/sequence.h"
#include "core/clock.h"
#include "core/image.h"

namespace lightstage::capture {

class LedController {
 public:
  virtual ~LedController() = default;
  virtual std::size_t light_count() const = 0;
  // Lights exactly these, all others off. Returns when the controller has acknowledged, not when the LEDs
  // have settled.
  virtual void show(std::span<const LightLevel> levels) = 0;
  // Everything off. Tried again by callers that get an exception: it must be safe to repeat.
  virtual void all_off() = 0;
};

struct CameraFrame {
  core::Image image;                 // linear radiance, already freed of black level; 1 or 3 channels
  double saturation = 0;             // radiance at which the sensor clips
  std::int64_t sequence_number = 0;  // counts the camera's exposures; gaps are lost frames, repeats are duplicates
  core::Nanoseconds timestamp = 0;   // start of exposure, on the session's clock
  bool damaged = false;              // the driver flagged it as incomplete
};

class Camera {
 public:
  virtual ~Camera() = default;
  virtual std::string name() const = 0;
  // Takes effect with the next exposure. Throws when the camera cannot do it; never rounds silently.
  virtual void set_exposure(core::Nanoseconds exposure) = 0;
  // The oldest frame not yet fetched; waits for one until `deadline` on the session's clock; nothing when
  // none came.
  virtual std::optional<CameraFrame> wait_frame(core::Nanoseconds deadline) = 0;
};

// Starts one exposure of every camera.
class Trigger {
 public:
  virtual ~Trigger() = default;
  virtual void fire() = 0;
};

}  // namespace lightstage::capture
