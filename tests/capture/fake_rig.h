// Scripted devices: every fault of lights, trigger and cameras at an exposure of the test's choice, in
// virtual time.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <set>
#include <vector>

#include "capture/session.h"
#include "core/clock.h"

namespace lightstage::test {

// What a camera does with one exposure.
struct Delivery {
  int copies = 1;  // 0: the frame is lost
  bool damaged = false;
  core::Nanoseconds start_delay = 0;  // from the trigger to the start of the exposure
  core::Nanoseconds late = 0;         // from the end of the exposure to the delivery
  bool raises_device_error = false;   // wait_frame throws when asked for it
};

// Pictures show which light lit them: see value_for(). A picture during which the lights changed shows
// kMixed.
class FakeRig {
 public:
  static constexpr float kAllOn = 500, kMixed = 1000, kDamaged = 2000;
  static float value_for(const std::vector<capture::LightLevel>& levels, std::size_t light_count);

  FakeRig(std::size_t light_count, std::size_t camera_count);
  ~FakeRig();
  capture::Rig rig();
  core::VirtualClock& clock() { return clock_; }
  std::vector<std::string> camera_names() const;

  // Puts a frame into the camera's queue before the session starts.
  void add_stale_frame(std::size_t camera, std::int64_t sequence_number, core::Nanoseconds timestamp,
                       bool damaged = false);

  // Scripts; exposures and calls count from 0.
  std::function<Delivery(std::size_t camera, int exposure)> delivery = [](std::size_t, int) { return Delivery{}; };
  std::function<void(int exposure)> on_fire = [](int) {};
  std::set<int> show_failures;  // show calls that throw DeviceError
  int all_off_failures = 0;     // this many all_off calls throw first
  bool pictures_are_finite = true;

  // What happened.
  bool any_light_on() const { return !lit_.empty(); }
  int exposures() const { return exposures_; }
  int all_off_calls() const { return all_off_calls_; }
  const std::vector<std::vector<capture::LightLevel>>& shown() const { return shown_; }

 private:
  class Lights;
  class Trigger;
  class Camera;
  void lights_change(std::vector<capture::LightLevel> levels);

  core::VirtualClock clock_;
  std::size_t light_count_;
  std::vector<capture::LightLevel> lit_;
  std::vector<std::vector<capture::LightLevel>> shown_;
  int exposures_ = 0, show_calls_ = 0, all_off_calls_ = 0;
  std::unique_ptr<Lights> lights_;
  std::unique_ptr<Trigger> trigger_;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::vector<capture::Camera*> camera_pointers_;
};

}  // namespace lightstage::test
