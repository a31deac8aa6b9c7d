#include "devices/trial.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "capture/session.h"
#include "core/error.h"
#include "sim/rig.h"

namespace lightstage::devices {

namespace {

constexpr std::size_t kLights = 10;
constexpr core::Nanoseconds kPause = 2 * core::kSecond;       // before somebody resumes
constexpr int kMendAfter = 3, kMostRuns = 8;                  // runs
constexpr core::Nanoseconds kLongest = 3600 * core::kSecond;  // of the devices' time

// Cameras as slow as real ones, so that frames are under way while lights change.
constexpr sim::DeviceTimes kTimes{.command = core::kMillisecond,
                                  .transfer = 12 * core::kMillisecond,
                                  .transfer_jitter = 2 * core::kMillisecond,
                                  .shortest_period = core::kSecond / 60};

sim::Simulation small_simulation() {
  capture::LayoutOptions layout;
  layout.lights = kLights;
  layout.cameras = 2;
  layout.camera_pixels = 16;
  sim::Simulation simulation;
  simulation.stage = capture::make_stage("faulty", layout);
  simulation.subject.kind = sim::SubjectKind::kGreyBall;
  simulation.subject.size_m = 0.12;
  simulation.motion = {.amplitude_m = 0, .rotation_degrees = 0};
  simulation.sensor.noise = false;
  simulation.pixel_samples = 1;
  return simulation;
}

capture::Sequence small_sequence() {
  capture::OlatOptions olat;
  olat.light_count = kLights;
  olat.tracking_every = 5;
  olat.dark_frames = 1;
  olat.exposure = 8 * core::kMillisecond;
  olat.full_on_exposure = 4 * core::kMillisecond;
  return capture::make_olat_sequence(olat);
}

double difference(const core::Image& a, const core::Image& b) {
  if (a.size() != b.size()) return INFINITY;
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i) {
    largest = std::max(largest, std::abs(double(a.values()[i]) - double(b.values()[i])));
  }
  return largest;
}

bool same_light(const db::Step& a, const db::Step& b) {
  const auto full = [](const db::Step& s) {
    return s.kind == db::StepKind::kFullOn || s.kind == db::StepKind::kTracking;
  };
  return (full(a) && full(b)) || (a.kind == b.kind && a.light_index == b.light_index);
}

}  // namespace

Bench::Bench() : world_(small_simulation()), sequence_(small_sequence()), store_(db::Store::create(folder_ / "store")) {
  const Frames& frames = expected(capture::Timing::kLockstep);
  least_difference_ = INFINITY;
  for (const auto& [a, image] : frames) {
    for (const auto& [b, other] : frames) {
      if (a.second != b.second ||
          same_light(sequence_.steps[std::size_t(a.first)], sequence_.steps[std::size_t(b.first)]))
        continue;
      least_difference_ = std::min(least_difference_, difference(image, other));
    }
  }
}

db::Scan Bench::begin_scan() {
  db::NewScan scan;
  scan.name = "pass" + std::to_string(scans_++);
  scan.stage_key = "faulty";
  for (const capture::StageCamera& camera : world_.simulation().stage.cameras) scan.cameras.push_back(camera.name);
  scan.steps = sequence_.steps;
  return store_.scan(store_.add_scan(scan));
}

Bench::Frames Bench::frames_of(const db::Scan& scan) const {
  Frames frames;
  for (const db::Frame& frame : store_.frames(scan.id)) {
    frames.emplace(std::pair(frame.step_index, frame.camera), store_.object(frame.object));
  }
  return frames;
}

const Bench::Frames& Bench::expected(capture::Timing timing) {
  const auto found = expected_.find(timing);
  if (found != expected_.end()) return found->second;
  core::VirtualClock clock;
  sim::SimulatedRig rig(world_, clock, kTimes);
  const db::Scan scan = begin_scan();
  capture::Sequence sequence = sequence_;
  sequence.timing = timing;
  const capture::SessionReport report = capture::run_session(store_, scan, sequence, rig.rig());
  if (report.retaken > 0) throw std::runtime_error("undisturbed, frames had to be taken again");
  return expected_.emplace(timing, frames_of(scan)).first->second;
}

Trial Bench::run(capture::Timing timing, const sim::FaultyRig::Plan& plan) {
  const Frames& frames = expected(timing);
  core::VirtualClock clock;
  sim::SimulatedRig rig(world_, clock, kTimes);
  sim::FaultyRig faulty(rig.rig(), plan);
  capture::Sequence sequence = sequence_;
  sequence.timing = timing;
  const db::Scan scan = begin_scan();
  Trial trial;
  for (int run = 1;; ++run) {
    bool done = false;
    try {
      capture::run_session(store_, scan, sequence, faulty.rig());
      done = true;
    } catch (const core::DeviceError& error) {
      ++trial.gave_up;
      if (std::string(error.what()).empty()) trial.complaints.push_back("a message without words");
    } catch (const std::exception& error) {
      trial.complaints.push_back(std::string("ended by another error: ") + error.what());
    }
    trial.lights_left_on = trial.lights_left_on || rig.any_light_on();
    if (done) break;
    clock.sleep_until(clock.now() + kPause);
    if (run == kMendAfter) faulty.mend();
    if (run == kMostRuns) {
      trial.complaints.push_back("does not end");
      break;
    }
  }
  if (clock.now() > kLongest) trial.complaints.push_back("took " + std::to_string(clock.now() / core::kSecond) + " s");
  trial.injected = faulty.injected();
  const Frames stored = frames_of(scan);
  trial.missing = frames.size() - std::min(frames.size(), stored.size());
  for (const auto& [place, image] : stored) {
    const auto wanted = frames.find(place);
    if (wanted == frames.end() || !(difference(image, wanted->second) <= kTolerance)) ++trial.wrong;
  }
  store_.remove_scan(scan.id);
  return trial;
}

}  // namespace lightstage::devices
