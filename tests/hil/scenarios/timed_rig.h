// A rig that notes how long it took from each trigger to the frame in the program's hands.
#pragma once

#include <deque>
#include <memory>
#include <vector>

#include "capture/session.h"

namespace lightstage::hil {

// Only for passes in which every trigger gives a frame of every camera.
class TimedRig {
 public:
  explicit TimedRig(const capture::Rig& rig);

  capture::Rig rig();
  // Mean over all frames; 0 where there was no trigger.
  double mean_latency_ms() const;

 private:
  struct Trigger;
  struct Camera;

  capture::Rig inner_;
  std::vector<std::shared_ptr<Camera>> cameras_;
  std::vector<capture::Camera*> pointers_;
  std::shared_ptr<Trigger> trigger_;
};

}  // namespace lightstage::hil
