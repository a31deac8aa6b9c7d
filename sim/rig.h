// The simulated back end: the device interfaces of capture over a World.
#pragma once

#include <memory>
#include <vector>

#include "capture/devices.h"
#include "capture/session.h"
#include "core/clock.h"
#include "sim/world.h"

namespace lightstage::sim {

// LEDs with rise time, cameras with exposure, jitter, noise and quantisation, a trigger; and faults as the
// simulation's FaultSpec says: those listed by exposure or call befall every camera alike, drop_probability and
// jitter each camera on its own. The devices behave as real ones do:
//
// - A frame shows the world at the middle of its exposure under the mean light of its exposure (LedBank). It is
//   rendered when it is fetched, and can be fetched from the end of the exposure on.
// - An exposure begins 4 standard deviations of the jitter after its trigger on average, and never before it.
// - A camera that is exposing misses the trigger. Exposures from 1 us to 10 s can be set.
// - A show() that times out switches nothing.
//
// Time is the given clock's: with a VirtualClock a capture takes no longer than its rendering. The subject's pose,
// the noise and the drops are functions of that clock and of the simulation's seed, so a pass can be repeated
// exactly; to resume one, sleep the clock to capture::end_of_last_exposure first.
class SimulatedRig {
 public:
  // The cameras of the world's stage, in order. World and clock must outlive the rig.
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
