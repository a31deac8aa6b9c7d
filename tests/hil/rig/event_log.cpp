#include "hil/rig/event_log.h"

#include <stdexcept>

namespace lightstage::hil {

EventLog::EventLog(const std::string& path) : file_(path, std::ios::app) {
  if (!file_) throw std::runtime_error("cannot write " + path);
}

void EventLog::write(Nanoseconds time, const char* event, nlohmann::json fields) {
  fields["t"] = time;
  fields["event"] = event;
  // Flushed: the log must be whole when a scenario ends, however it ends.
  file_ << fields.dump() << std::endl;
}

nlohmann::json lit_cells(const Levels& levels) {
  nlohmann::json lit = nlohmann::json::array();
  for (std::size_t cell = 0; cell < kCells; ++cell) {
    const Rgb& level = levels[cell];
    if (level != Rgb{}) lit.push_back({cell, level[0], level[1], level[2]});
  }
  return lit;
}

}  // namespace lightstage::hil
