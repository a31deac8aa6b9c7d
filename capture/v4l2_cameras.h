// Cameras behind the kernel's V4L2 drivers: which there are, and one opened for measuring.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "capture/devices.h"
#include "capture/hardware.h"
#include "capture/stage.h"
#include "core/clock.h"

namespace lightstage::capture {

// Sizes of pictures; where smallest and largest differ, all between them in these steps.
struct V4l2Size {
  int width = 0, height = 0;  // pixels
  int largest_width = 0, largest_height = 0;
  int width_step = 1, height_step = 1;
  std::vector<double>
      rates;  // frames a second at the smallest size, fast to slow; empty where the driver does not tell
  bool any_rate_between = false;
};

struct V4l2Format {
  std::string pixel_format;  // as in the stage file: "Y16", "RGGB"
  std::string description;   // the driver's
  std::string refused;       // why nothing can be measured in it; empty: it can be used
  std::vector<V4l2Size> sizes;
};

struct V4l2CameraSeen {
  std::string node;      // "/dev/video0"
  std::string card;      // "UVC Camera (046d:0825)"
  std::string driver;    // "uvcvideo"
  std::string bus_path;  // "usb-0000:00:14.0-2"; stays while the camera stays in its socket
  std::string serial;    // USB serial number; empty where it has none
  std::vector<V4l2Format> formats;
  // One word each: what of the camera can be set.
  bool has_exposure = false;  // in units of time
  bool has_trigger = false;   // a control that switches between triggered and free running
  std::string problem;        // why it cannot be used, and what to do; empty: it can be
};

// Cameras in the order of their node numbers, once each: a camera's other nodes (metadata) are left out. Opens every video
// node for a moment and sets nothing. A camera that cannot be opened is listed with its problem. Does not throw DeviceError.
std::vector<V4l2CameraSeen> v4l2_cameras_seen();

// Channels of the pictures that such a camera delivers: 1 or 3. BadInput for a pixel format that cannot be measured in.
int picture_channels(const CameraDevice& device);

// Finds the camera by CameraDevice::match, sets it up, and lets it stream: format as CameraDevice and picture size as StageCamera ask, everything
// automatic off, gain, the fastest frame rate. What the driver grants is read back.
//
// Exposures are multiples of the driver's steps (0.1 ms, in V4L2); others are refused by name of the nearest ones. A frame
// rate that is too fast for an exposure is lowered, and stays so: to change it streaming must stop, and frames on their way
// are lost. Before the first set_exposure frames are given as if exposed for one second.
//
// A frame's time stamp is the driver's where that is the start of the exposure; where it is its end, less the exposure;
// plus CameraDevice::timestamp_offset. Drivers that do not stamp by CLOCK_MONOTONIC are refused. Sequence numbers are the
// driver's, free of wraps, and go on above all earlier ones whenever streaming starts anew. A frame that is flagged, or
// shorter than its format, is `damaged`.
//
// When the device fails (unplugged, I/O error) the call throws DeviceError and the next one finds and opens it again, with
// all that was set; node numbers may have changed. set_exposure and set_exposing wait for it to come back, 3 s at most;
// wait_frame until its deadline.
//
// Throws DeviceError naming the camera and what to do when it is not there, not permitted, used by another program, or does
// not grant what the stage file asks for; BadInput for a pixel format that cannot be measured in, and a linearisation that
// does not rise. `clock` must be CLOCK_MONOTONIC, by which drivers stamp, and outlive the camera.
std::unique_ptr<Camera> open_v4l2_camera(const StageCamera& camera, const CameraDevice& device, core::Clock& clock);

}  // namespace lightstage::capture
