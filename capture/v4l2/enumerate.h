// Which video nodes are cameras, and which of them is meant.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "capture/v4l2/video_system.h"
#include "capture/v4l2_cameras.h"

namespace lightstage::capture {

// As v4l2_cameras_seen().
std::vector<V4l2CameraSeen> cameras_seen(VideoSystem& system);

// The node of the camera that `match` (CameraDevice::match) means. Of several nodes of one camera the first that offers the
// pixel format, else the first. A match that is a path ("/dev/video0", "/dev/v4l/by-id/...") is given back as it is. Throws
// DeviceError naming `user` and the cameras that are there when none matches, or two cameras do.
std::string find_camera_node(VideoSystem& system, const std::string& match, std::uint32_t fourcc,
                             const std::string& user);

}  // namespace lightstage::capture
