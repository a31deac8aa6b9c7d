// An emulated CP2112, a USB chip with eight general-purpose lines that the kernel's hid-cp2112 makes a GPIO chip of (label
// "cp2112_gpio"), through /dev/uhid. Reports: Silicon Labs application note AN495.
#pragma once

#include <linux/uhid.h>

#include <cstdint>
#include <functional>

#include "hil/rig/file_descriptor.h"
#include "hil/rig/scene.h"

namespace lightstage::hil {

class Cp2112 {
 public:
  // Called for each output line that changed.
  std::function<void(int line, bool high)> on_line;
  // Called for each request to change lines.
  std::function<void()> on_request;

  void plug();
  void unplug();
  bool plugged() const { return static_cast<bool>(uhid_); }

  // What is on an input line. The driver looks about every 40 ms, so it misses what is shorter.
  void set_input(int line, bool high);

  // The next requests to change lines are refused (the driver gets an error), or accepted without effect (it does not).
  void refuse(int requests) { refuse_ = requests; }
  void ignore(int requests) { ignore_ = requests; }

  int fd() const { return uhid_.get(); }
  void serve();

 private:
  void send(const uhid_event& event);
  void get_report(const uhid_get_report_req& request);
  void set_report(const uhid_set_report_req& request);
  void set_outputs(std::uint8_t values);

  FileDescriptor uhid_;
  std::uint8_t outputs_mask_ = 0;  // lines that are outputs
  std::uint8_t values_ = 0, inputs_ = 0;
  int refuse_ = 0, ignore_ = 0;
};

}  // namespace lightstage::hil
