// A GPIO chip in virtual time, with the faults that real ones have.
#pragma once

#include <deque>
#include <memory>
#include <vector>

#include "capture/gpio/lines.h"
#include "core/clock.h"

namespace lightstage::test {

// What the lines of the fake chip are and do; shared by the test and the objects that the code under test makes.
struct FakeGpio {
  core::Clock* clock = nullptr;
  core::Nanoseconds set_takes = 0, read_takes = 0;

  // Faults.
  bool plugged_in = true;
  core::Nanoseconds comes_back_at = -1;  // plugs itself in then
  bool tells_outputs = true;             // false: read() fails, as on a chip without inputs
  std::vector<bool> ignores_orders;      // by line: set() reports success and does nothing
  int failing_sets = 0;                  // this many set() throw, after `good_sets` that do not
  int good_sets = 0;
  int failing_edges = 0;  // this many next_edge() throw
  bool edges_never_end = false;

  // Levels now (true: active), and every change of line 0.
  std::vector<bool> levels;
  struct Change {
    core::Nanoseconds time;
    bool active;
  };
  std::vector<Change> changes;
  std::deque<core::Nanoseconds> edges;  // to come, in order of time; a time in the past is heard at once

  // What was asked.
  std::vector<capture::GpioRequest> requests;
  int sets = 0;
  int reads = 0;
  int held = 0;  // requests that live

  bool any_active() const;
  bool is_there();
};

std::unique_ptr<capture::GpioChips> fake_chips(FakeGpio& gpio);

}  // namespace lightstage::test
