// The part of a stage file that says which devices the stage is wired to (docs/hardware.md).
#pragma once

#include <string>

#include "capture/hardware.h"
#include "core/config.h"

namespace lightstage::capture {

// What the whole stage table `stage` holds of hardware: [[controller]], [trigger], [strobe], the `device` of each [[camera]],
// and `controller` and `channels` of each [[light]]; empty where there is none of it. Throws BadInput naming file and
// line for everything that could not work on any machine: a controller that is not in the file or drives no light,
// controllers that cannot be told apart, two lights on one channel, channels out of range, a camera without a device
// beside one that has it, cameras that wait for a trigger that is not described, a trigger that has neither one line nor
// one for each camera.
Hardware read_hardware(const core::TomlTable& stage);

// The inverse, in the pieces of which a stage file is made. The first one is a comment that points to the guide where there
// is no hardware.
std::string controllers_and_lines_toml(const Hardware& hardware);  // before the first [[camera]]
std::string device_toml(const CameraDevice& device);               // at the end of a [[camera]]
std::string wiring_toml(const LightWiring& wiring);                // at the end of a [[light]]

}  // namespace lightstage::capture
