// The devices of a stage as `lightstage doctor` prints them.
#pragma once

#include <string>

#include <nlohmann/json_fwd.hpp>

#include "capture/devices_seen.h"

namespace lightstage::cli {

// A paragraph for each kind of device, with formats, sizes, rates and lines.
std::string devices_text(const capture::DevicesSeen& seen);
// {controllers, cameras, gpio_chips}
nlohmann::ordered_json devices_json(const capture::DevicesSeen& seen);

}  // namespace lightstage::cli
