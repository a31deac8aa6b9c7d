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
  core::Nanoseconds stamp_late = 0;   // of the time stamp, after the start
  bool swallowed = false;             // the trigger is not obeyed: no exposure, no strobe, no number
  core::Nanoseconds late = 0;         // from the end of the exposure to the delivery
  bool raises_device_error = false;   // wait_frame throws when asked for it
};

// Pictures show which light lit them: see value_for(). A picture during which the lights changed shows their mean over the
// exposure plus kMixture, which is no light's value; one added by hand kMixed.
class FakeRig {
 public:
  static constexpr float kAllOn = 500, kMixed = 1000, kDamaged = 2000, kMixture = 0.371f;
  static float value_for(const std::vector<capture::LightLevel>& levels, std::size_t light_count);

  FakeRig(std::size_t light_count, std::size_t camera_count);
  ~FakeRig();
  capture::Rig rig();
  core::VirtualClock& clock() { return clock_; }
  std::vector<std::string> camera_names() const;

  // Puts a frame into the camera's queue before the session starts.
  void add_stale_frame(std::size_t camera, std::int64_t sequence_number, core::Nanoseconds timestamp,
                       bool damaged = false);

  // Times of the devices.
  core::Nanoseconds command_time = 0;  // show() takes so long, the lights change half way
  core::Nanoseconds fire_time = 0;     // Trigger::fire() takes so long; camera n is triggered after n-th parts of it
  core::Nanoseconds strobe_time = 0;   // from the end of camera 0's exposure to the next pattern, besides arm()'s delay
  core::Nanoseconds least_period = 0;  // of the cameras
  core::Nanoseconds phase_of_camera = 0;  // running free, camera n begins n times this later
  bool holds_sequences = false;           // has a PatternPlayer

  // Scripts; exposures and calls count from 0.
  std::function<Delivery(std::size_t camera, int exposure)> delivery = [](std::size_t, int) { return Delivery{}; };
  std::function<void(int exposure)> on_fire = [](int) {};
  std::set<int> show_failures;    // show calls that throw DeviceError
  std::set<int> strobe_bounces;   // exposures whose strobe the controller hears twice
  std::set<int> strobe_failures;  // exposures whose strobe the controller does not hear
  int all_off_failures = 0;       // this many all_off calls throw first
  bool pictures_are_finite = true;

  // What happened.
  bool any_light_on() const { return !changes_.empty() && !changes_.back().levels.empty(); }
  int exposures() const { return exposures_; }
  int all_off_calls() const { return all_off_calls_; }
  const std::vector<std::vector<capture::LightLevel>>& shown() const { return shown_; }

 private:
  struct Change {
    core::Nanoseconds time = 0;
    std::vector<capture::LightLevel> levels;
  };
  class Lights;
  class Trigger;
  class Camera;
  void change_lights(core::Nanoseconds time, std::vector<capture::LightLevel> levels);
  // What a picture shows of the lights between these times.
  float value_between(core::Nanoseconds begin, core::Nanoseconds end) const;

  core::VirtualClock clock_;
  std::size_t light_count_;
  std::vector<Change> changes_;  // in order of time
  std::vector<std::vector<capture::LightLevel>> shown_;
  int exposures_ = 0, show_calls_ = 0, all_off_calls_ = 0;
  std::unique_ptr<Lights> lights_;
  std::unique_ptr<Trigger> trigger_;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::vector<capture::Camera*> camera_pointers_;
};

}  // namespace lightstage::test
