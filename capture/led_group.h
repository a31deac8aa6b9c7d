// Several LED controllers as one.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "capture/devices.h"

namespace lightstage::capture {

struct LedGroupMember {
  std::string name;  // precedes its faults
  std::unique_ptr<LedController> controller;
  std::vector<int> lights;  // for each of the controller's lights, which light of the group it is
};

// Every light of 0 to n - 1 must be one member's. Calls go to every member, one after another, even when one of them fails; what
// failed is thrown at the end, all DeviceErrors in one, so that no member is left lit because another one is gone.
//
// status() gives the highest temperature, the lowest voltage and all faults. The group has a pattern player where every member
// has one; all of them must hear the strobe then, and a pattern is reached when the last of them has reached it.
std::unique_ptr<LedController> make_led_group(std::vector<LedGroupMember> members);

}  // namespace lightstage::capture
