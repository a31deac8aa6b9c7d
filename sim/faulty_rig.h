// Devices that fail: every call of the interfaces in capture/devices.h disturbed on purpose, between a session and the rig that it drives.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "capture/session.h"
#include "core/clock.h"

namespace lightstage::sim {

enum class DeviceCall {
  kShow,
  kAllOff,
  kStatus,
  kLoad,
  kArm,
  kPosition,
  kWaitForPattern,
  kFire,
  kSetExposure,
  kSetExposing,
  kFramePeriod,
  kWaitFrame,  // of those that bring a frame
};
inline constexpr std::array kDeviceCalls{
    DeviceCall::kShow,        DeviceCall::kAllOff,      DeviceCall::kStatus,         DeviceCall::kLoad,
    DeviceCall::kArm,         DeviceCall::kPosition,    DeviceCall::kWaitForPattern, DeviceCall::kFire,
    DeviceCall::kSetExposure, DeviceCall::kSetExposing, DeviceCall::kFramePeriod,    DeviceCall::kWaitFrame};
std::string_view to_string(DeviceCall call);

enum class DeviceFault {
  kTimeOut,     // throws after 400 ms; nothing was done
  kAnswerLost,  // it was done; throws after 400 ms all the same. A frame is gone
  kGarbage,  // nonsense for an answer: faults that no controller has, patterns and times that are not so, periods of years. Of a frame: a picture of noise,
             // which its driver flags
  kNotANumber,  // a frame with NaN in it
  kWrongSize,   // a frame twice as wide
  kShort,  // a frame whose lower half is missing, and not flagged; of fire(): nothing is exposed, and no word of it
  kStale,  // before the frame comes an older one again, as it was; the newest first, so that it is sometimes its neighbour
  kDuplicate,  // the frame comes twice
  kVanish,  // the device is gone for a second: every call of it throws at once. Lights go out; what a camera exposed meanwhile is lost
  kVanishForGood,  // until mend()
};
inline constexpr std::array kDeviceFaults{DeviceFault::kTimeOut,      DeviceFault::kAnswerLost, DeviceFault::kGarbage,
                                          DeviceFault::kNotANumber,   DeviceFault::kWrongSize,  DeviceFault::kShort,
                                          DeviceFault::kStale,        DeviceFault::kDuplicate,  DeviceFault::kVanish,
                                          DeviceFault::kVanishForGood};
std::string_view to_string(DeviceFault fault);

// Whether the fault means something for the call.
bool can_befall(DeviceFault fault, DeviceCall call);

// Wraps the devices of another rig, which must outlive it, as must its clock. Used by one thread.
class FaultyRig {
 public:
  // What befalls the n-th call of its kind (from 0; of cameras, all together); asked once for each.
  using Plan = std::function<std::optional<DeviceFault>(DeviceCall call, int n)>;
  FaultyRig(const capture::Rig& rig, Plan plan);
  ~FaultyRig();
  FaultyRig(const FaultyRig&) = delete;
  FaultyRig& operator=(const FaultyRig&) = delete;

  capture::Rig rig();
  // Faults that have happened.
  int injected() const;
  // What vanished is back, and nothing fails any more.
  void mend();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lightstage::sim
