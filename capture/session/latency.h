// Measurements before a fast pass: how late a camera's time stamps are, and how bright its pictures.
#pragma once

#include "capture/session/frame_matcher.h"
#include "capture/session/pass.h"

namespace lightstage::capture {

// Mean values of a camera's picture with no light and with all of them.
struct Brightness {
  double dark = 0, full = 0;
};

struct CameraReference {
  Latency latency;
  core::Nanoseconds tolerance = 0;  // by how much stamps may lie outside without a reason to doubt them
  core::Nanoseconds arrival = 0;    // frames come so long after their stamp, with time to spare
  Brightness brightness;
};

struct Reference {
  std::vector<CameraReference> cameras;   // as Pass::feeds()
  core::Nanoseconds longest_trigger = 0;  // from calling Trigger::fire() until every camera was triggered, at most
};

// Of one camera, by exposure.
std::map<core::Nanoseconds, Brightness> brightness_of(const std::map<core::Nanoseconds, Reference>& references,
                                                      std::size_t camera);

double mean_value(const core::Image& image);

// Triggers a few exposures of this length, with and without light. The latency is that of the stamps after fire() was called,
// the camera's own delay included. Frames are thrown away. DeviceError, naming the camera, where too few frames come.
Reference measure_triggered(Pass& pass, core::Nanoseconds exposure);

// The same for cameras that run free, whose exposures nobody starts: the lights are switched on and off at irregular times
// (never faster than 3 times a second: that can harm), and the latency is what explains how much light each frame saw. Takes
// about 3 s. DeviceError where no latency within -50 to 500 ms explains three quarters of the frames, or the cameras do not see
// the lights.
Reference measure_free_running(Pass& pass, core::Nanoseconds exposure);

}  // namespace lightstage::capture
