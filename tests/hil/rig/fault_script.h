// What goes wrong, and when: by counting what happens in the rig, never by time.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "hil/rig/uvc_camera.h"

namespace lightstage::hil {

// A line is an action, done at once, or `at EVENT NUMBER ACTION`: when the event happens for that time since the scenario
// began (counted from 1). Events:
//   exposure  began: for actions on a frame that of the camera which they name, for others that of camera 0
//   show      new levels were sent to the DMX widget
//   request   a message was sent to the LED controller; it is not answered before the action is done
//   write     a GPIO line was written
// Actions on the frame of one exposure (at exposure ...) are kept here; all others are passed on:
//   drop CAMERA, short CAMERA, error CAMERA, duplicate CAMERA, late CAMERA MILLISECONDS
class FaultScript {
 public:
  // Carries out an action that is not about a frame, as its words.
  std::function<void(const std::vector<std::string>& words)> act;

  // Throws std::runtime_error for a line that it does not understand.
  void add(const std::string& line);
  void clear();
  // Lines that did not happen yet.
  std::size_t size() const;

  void happened(const std::string& event);
  // What befalls this exposure of the camera. Counts as its event `exposure`.
  FrameFault exposure(int camera, int number);

 private:
  using Words = std::vector<std::string>;
  std::map<std::string, int> counts_;
  std::map<std::pair<std::string, int>, std::vector<Words>> waiting_;  // by event and number
  std::map<std::pair<int, int>, FrameFault> frame_faults_;             // by camera and exposure
};

std::vector<std::string> words(const std::string& line);
// The N of "camN"; -1 for anything else.
int camera_number(const std::string& word);

}  // namespace lightstage::hil
