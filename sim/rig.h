// The simulated back end: the device interfaces of capture over a World.
#pragma once

#include <memory>
#include <vector>

#include "capture/devices.h"
#include "capture/light_limits.h"
#include "capture/session.h"
#include "core/clock.h"
#include "sim/world.h"

namespace lightstage::sim {

// How long simulated devices take. All zero: as fast as the physics of exposure allows.
struct DeviceTimes {
  core::Nanoseconds command = 0;          // from a command to the controller's answer; the lights change half way
  core::Nanoseconds transfer = 0;         // from the end of an exposure until its frame can be fetched
  core::Nanoseconds transfer_jitter = 0;  // up to so much longer
  core::Nanoseconds shortest_period = 0;  // between the starts of a camera's exposures
  bool stamped_on_arrival = false;        // frames carry the time at which they can be fetched
  bool triggered = true;                  // cameras have a trigger input; others always run free
};

// What the simulated controller keeps by itself, whatever it is told.
struct ControllerLimits {
  std::optional<capture::LightLimits> heat = {};      // its duty and on-time
  std::optional<capture::LightLimits> flashing = {};  // LedFirmwareOptions::flashing
};

// LEDs with rise time, cameras with exposure, jitter, noise and quantisation, a trigger; and faults as the
// simulation's FaultSpec says: those listed by exposure or call befall every camera alike, drop_probability and
// jitter each camera on its own. The devices behave as real ones do:
//
// - A frame shows the world at the middle of its exposure under the mean light of its exposure (LedBank). It is
//   rendered when it is fetched, and can be fetched from the end of the exposure on.
// - An exposure begins 4 standard deviations of the jitter after its trigger on average, and never before it.
// - A camera that is exposing, or whose shortest period has not passed, misses the trigger. Exposures from 1 us to 10 s can be set.
// - A camera that runs free exposes every shortest period, or as fast as the exposure lets it, from a phase of its own.
// - The LED controller is the firmware of led_firmware.h, spoken to in its protocol. It steps through a loaded sequence at the
//   end of the first camera's exposures.
// - A show() that times out switches nothing.
//
// Time is the given clock's: with a VirtualClock a capture takes no longer than its rendering. The subject's pose,
// the noise and the drops are functions of that clock and of the simulation's seed, so a pass can be repeated
// exactly; to resume one, sleep the clock to capture::end_of_last_exposure first.
class SimulatedRig {
 public:
  // The cameras of the world's stage, in order. World and clock must outlive the rig. The controller keeps its limits, where it has some.
  SimulatedRig(const World& world, core::Clock& clock, const DeviceTimes& times = {},
               const ControllerLimits& limits = {});
  ~SimulatedRig();
  SimulatedRig(const SimulatedRig&) = delete;
  SimulatedRig& operator=(const SimulatedRig&) = delete;

  capture::Rig rig();

  // For tests of the session: true while any LED is lit.
  bool any_light_on() const;
  // Exposures triggered so far.
  int exposures() const;
  // The truth about a frame that was delivered: the mean levels of the lights during its exposure, of those that gave any.
  // Throws std::out_of_range for a frame that was not.
  // May be called from any thread.
  std::vector<capture::LightLevel> light_in_frame(std::size_t camera_index, std::int64_t sequence_number) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lightstage::sim
