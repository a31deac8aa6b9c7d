// Picture format and the automatics of a camera that is about to measure.
#pragma once

#include <cstddef>

#include "capture/v4l2/raw_to_linear.h"
#include "capture/v4l2/unpack.h"
#include "capture/v4l2/video_device.h"

namespace lightstage::capture {

struct GrantedFormat {
  BufferLayout layout;
  ColourEncoding encoding;
  std::size_t buffer_bytes = 0;
};

// Throws DeviceError naming wanted and granted when the driver grants anything but this format and size, progressive, in
// an encoding that can be decoded; VideoError when it refuses.
GrantedFormat set_format(const VideoDevice& device, const PixelFormat& format, int width, int height);

// Whatever a camera would do by itself between two pictures goes off, where it has it: automatic exposure, gain, white balance,
// focus, brightness, hue; backlight compensation, wide dynamic range, stabilisation; frame rates that follow the exposure.
// Throws DeviceError when one stays on.
void switch_off_automatics(const VideoDevice& device);

// Analogue gain where there is no plain one. Throws DeviceError when there is neither, or the driver grants another.
void set_gain(const VideoDevice& device, int gain);

}  // namespace lightstage::capture
