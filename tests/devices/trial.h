// One pass of a simulated stage whose devices fail, and what came of it.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "capture/sequence.h"
#include "db/store.h"
#include "sim/faulty_rig.h"
#include "sim/world.h"
#include "support/support.h"

namespace lightstage::devices {

struct Trial {
  int injected = 0;             // faults
  int gave_up = 0;              // runs that ended with a DeviceError, after which the pass was resumed
  std::size_t wrong = 0;        // frames stored that do not show their step's light
  std::size_t missing = 0;      // frames of the pass that are not there at its end
  bool lights_left_on = false;  // at the end of any run
  std::vector<std::string> complaints;
  bool survived() const { return wrong == 0 && missing == 0 && !lights_left_on && complaints.empty(); }
};

// A small stage with two cameras before a still subject, without noise, whose every frame is known.
class Bench {
 public:
  Bench();

  // Runs the pass, resumes it after every DeviceError, mends the devices after the third, and looks at what is stored. Everything else that
  // is thrown, a pass that does not end in so many runs or takes hours, and a message of more than a line are complaints.
  Trial run(capture::Timing timing, const sim::FaultyRig::Plan& plan);

  // The least difference between frames of different lights (largest over a frame's values), and what frames of one light may differ by.
  double least_difference() const { return least_difference_; }
  static constexpr double kTolerance = 0.01;

 private:
  using Frames = std::map<std::pair<int, std::string>, core::Image>;  // by step and camera
  Frames frames_of(const db::Scan& scan) const;
  const Frames& expected(capture::Timing timing);
  db::Scan begin_scan();

  sim::World world_;
  capture::Sequence sequence_;
  test::TemporaryFolder folder_;
  db::Store store_;
  std::map<capture::Timing, Frames> expected_;
  double least_difference_ = 0;
  int scans_ = 0;
};

}  // namespace lightstage::devices
