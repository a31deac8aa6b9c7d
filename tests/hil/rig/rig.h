// The whole emulated stage: its devices, the wires between them, and what goes wrong.
//
// Wires: GPIO line N triggers camera N, line kCommonTrigger all of them, each on the rising edge. The strobe output of camera 0
// (high while it exposes) goes to the strobe input of the LED controller and to GPIO line kStrobeInput.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "hil/rig/cp2112.h"
#include "hil/rig/dmx_widget.h"
#include "hil/rig/event_log.h"
#include "hil/rig/fault_script.h"
#include "hil/rig/led_device.h"
#include "hil/rig/scene.h"
#include "hil/rig/uvc_camera.h"

namespace lightstage::hil {

constexpr int kCommonTrigger = 4, kStrobeInput = 6;
constexpr int kMostCameras = 4;

class Rig {
 public:
  // Plugs in everything but the DMX widget.
  Rig(int cameras, const std::string& log_path);

  // Serves the devices and obeys the commands that come from standard input, one a line, each answered by a line
  // on standard output ("ok", an answer, or "error: ..."), until that ends. Commands:
  //   begin NAME                 a scenario begins: the script is empty, counters start again, the LED controller is cool
  //   state                      answered by {"lit": cells that are not dark, "script": lines that did not happen yet,
  //                              "exposures": that ended since the scenario began, of all cameras}
  //   free camN, triggered camN  how the camera exposes from now on
  //   what FaultScript understands, with these actions (DEVICE: led, dmx, gpio, camN):
  //     plug DEVICE
  //     unplug DEVICE [MILLISECONDS]   and back again after so long
  //     cut led MILLISECONDS           the same in the middle of the next transfer to it
  //     renumber gpio MILLISECONDS     the same, and comes back under another number
  //     mute led TRANSFERS, stall led TRANSFERS
  //     refuse gpio REQUESTS, ignore gpio REQUESTS
  void run();

 private:
  struct Replug {
    std::string device;
    Nanoseconds time = 0;
  };

  UvcCamera& camera(const std::string& word);
  void wire(UvcCamera& camera);
  void trigger(UvcCamera& camera);
  void log_exposure(const UvcCamera& camera, const UvcCamera::Exposure& exposure);

  std::string obey(const std::string& line);
  void act(const std::vector<std::string>& words);
  bool plug(const std::string& device);
  void unplug(const std::string& device);
  void replug_later(const std::string& device, const std::vector<std::string>& words);
  void hold_gpio_number();

  std::optional<Nanoseconds> next_event() const;
  void advance_all(Nanoseconds until);
  void replug_due(Nanoseconds time);

  EventLog log_;
  Scene scene_;
  FaultScript script_;
  LedDevice led_;
  DmxWidget dmx_;
  Cp2112 gpio_;
  std::vector<std::unique_ptr<UvcCamera>> cameras_;
  std::vector<Replug> replugs_;
  FileDescriptor held_chip_;      // while it is open, its number is not given to another chip
  std::vector<std::string> cut_;  // the words of `cut`, until it happens
  std::size_t lit_ = 0;           // cells
  int exposures_ = 0;             // that ended since the scenario began, of all cameras
};

}  // namespace lightstage::hil
