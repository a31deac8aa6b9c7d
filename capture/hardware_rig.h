// The devices of a real stage, opened as its file describes them.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "capture/devices.h"
#include "capture/session.h"
#include "capture/stage.h"
#include "core/clock.h"

namespace lightstage::capture {

struct HardwareOptions {
  // This program's file. Where it is given, each DMX widget, which would hold its last state for ever, is watched by a
  // process that runs `PROGRAM lights-off --dmx-serial SERIAL` should this one die.
  std::filesystem::path program;
};

// Owns the controllers, cameras, trigger and strobe of a stage. Several controllers appear as one.
class HardwareRig {
 public:
  // Opens everything; all lights are off then. Throws UsageError for a stage whose file describes no controllers or no
  // cameras, DeviceError (BadInput for pixel formats and linearisations) for a device that does not do as the file says.
  // `clock` must be the system's, by which drivers stamp, and outlive the rig.
  HardwareRig(const Stage& stage, core::Clock& clock, const HardwareOptions& options = {});
  // Lights off.
  ~HardwareRig();
  HardwareRig(const HardwareRig&) = delete;
  HardwareRig& operator=(const HardwareRig&) = delete;

  // Valid as long as this object.
  Rig rig();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// For emergencies: turns off every light of the stage, going on when a controller fails or is missing. One line for each that
// did, in the order of the file; empty when all lights are off. Throws UsageError where the file describes no controllers.
std::vector<std::string> turn_lights_off(const Stage& stage, core::Clock& clock);

}  // namespace lightstage::capture
