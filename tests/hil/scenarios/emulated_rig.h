// The process that emulates the stage's devices (tests/hil/rig), from the side of the scenarios.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/clock.h"

namespace lightstage::hil {

constexpr int kRigCameras = 2;

class EmulatedRig {
 public:
  // The one that serves all scenarios; started at the first call, which returns when the kernel has found all devices.
  static EmulatedRig& instance();
  ~EmulatedRig();
  EmulatedRig(const EmulatedRig&) = delete;
  EmulatedRig& operator=(const EmulatedRig&) = delete;

  // Commands of Rig::run; returns the answer. Throws std::runtime_error when it is refused.
  std::string command(const std::string& line);
  nlohmann::json state();

  // What happened since the newest `begin`, oldest first (event_log.h).
  std::vector<nlohmann::json> events() const;
  // The first time from `time` on at which no light was on; nothing when there was none yet.
  std::optional<core::Nanoseconds> dark_from(core::Nanoseconds time) const;

 private:
  EmulatedRig();
  std::string answer();

  std::filesystem::path log_;
  pid_t process_ = -1;
  int to_rig_ = -1, from_rig_ = -1;
  std::string received_;
};

// Where logs and summaries go: $LIGHTSTAGE_HIL_OUT. Throws std::runtime_error where it is not set: these tests need the virtual
// machine that tests/hil/run starts.
std::filesystem::path output_folder();

}  // namespace lightstage::hil
