// What really happened in the rig, one JSON object a line: scenarios prove by it what the program did.
//
// Every line has "t" (nanoseconds of CLOCK_MONOTONIC) and "event":
//   begin     name: a scenario began; counters start again
//   lights    lit: [[cell, r, g, b], ...] from t on, levels 0 to 1; everything else is dark
//   exposure  camera, number (from 1), start, end, lit: [[cell, r, g, b], ...] mean levels, sent: what became of its frame
//   trigger   camera, taken: false when the camera was busy, not streaming or running free
//   stream    camera, on
//   plug, unplug   device
//   fault     action: one of the script happened
#pragma once

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "hil/rig/scene.h"

namespace lightstage::hil {

class EventLog {
 public:
  explicit EventLog(const std::string& path);
  void write(Nanoseconds time, const char* event, nlohmann::json fields = nlohmann::json::object());

 private:
  std::ofstream file_;
};

// [[cell, r, g, b], ...] of those that are not dark.
nlohmann::json lit_cells(const Levels& levels);

}  // namespace lightstage::hil
