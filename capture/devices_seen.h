// Which devices of a stage this machine has, without opening them for use.
#pragma once

#include <string>
#include <vector>

namespace lightstage::capture {

struct DeviceSeen {
  std::string kind;         // "camera" or "gpio"
  std::string path;         // as /dev/video0
  bool accessible = false;  // this user may read and write it
};

// Video nodes and GPIO chips under /dev, in order of path.
std::vector<DeviceSeen> devices_seen();

}  // namespace lightstage::capture
