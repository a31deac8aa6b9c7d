// The simulated back end: the device interfaces of capture over a World.
#pragma once

#include <memory>
#include <vector>

#include "capture/devices.h"
#include "capture/session.h"
#include "core/clock.h"
#include "sim/world.h"

namespace lightstage::sim {

// LEDs with rise time, cameras with exposure, jitter, noise and quantisation, a trigger; and faults as the simulation's FaultSpec says.
// Time is the given clock's: with a VirtualClock a capture takes no longer than its rendering. The subject's pose is a
// function of that clock: to resume a pass, sleep the clock to the last stored time stamp first.
class SimulatedRig {
 public:
  // The cameras of the world's stage, in order.
  SimulatedRig(const World& world, core::Clock& clock);
  ~SimulatedRig();
  SimulatedRig(const SimulatedRig&) = delete;
  SimulatedRig& operator=(const SimulatedRig&) = delete;

  capture::Rig rig();

  // For tests of the session: true while any LED is lit.
  bool any_light_on() const;
  // Exposures triggered so far.
  int exposures() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lightstage::sim
