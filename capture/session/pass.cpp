#include "capture/session/pass.h"

#include <algorithm>
#include <cstdio>

#include "core/error.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {
constexpr core::Nanoseconds kPoll = core::kMillisecond / 2;  // between looks for frames
constexpr std::size_t kMostBytesTogether = std::size_t{1} << 30;
}  // namespace

std::string describe(const db::Step& step) {
  const std::string light = step.light_index ? ", light " + std::to_string(*step.light_index) : "";
  return "step " + std::to_string(step.step_index) + " (" + std::string(db::to_string(step.kind)) + light + ")";
}

Pass::Pass(const std::string& name, const Sequence& sequence, const Rig& rig, const SessionOptions& options,
           Stored stored, FrameKeeper::Target target)
    : sequence_(sequence),
      rig_(rig),
      options_(options),
      stored_(std::move(stored)),
      begin_(rig.clock.now()),
      progress_("capture " + name, sequence.steps.size() * rig.cameras.size() - stored_.size()),
      keeper_(std::move(target)) {
  for (Camera* camera : rig.cameras) feeds_.emplace_back(*camera);
  report_.steps = sequence.steps.size();
  report_.already_stored = stored_.size();
}

std::vector<LightLevel> Pass::levels_of(const db::Step& step) const {
  return levels(step, rig_.lights.light_count());
}

bool Pass::missing(const db::Step& step, const CameraFeed& feed) const {
  return !stored_.contains({step.step_index, feed.name()});
}

std::vector<CameraFeed*> Pass::cameras_without(const db::Step& step) {
  std::vector<CameraFeed*> without;
  for (CameraFeed& feed : feeds_) {
    if (missing(step, feed)) without.push_back(&feed);
  }
  return without;
}

std::vector<const db::Step*> Pass::unfinished() {
  std::vector<const db::Step*> steps;
  for (const db::Step& step : sequence_.steps) {
    if (!cameras_without(step).empty()) steps.push_back(&step);
  }
  return steps;
}

int Pass::tries(const db::Step& step) const {
  const auto found = tries_.find(step.step_index);
  return found == tries_.end() ? 0 : found->second;
}

Pass::Triggered Pass::trigger() {
  rig_.clock.sleep_until(cameras_ready_);
  core::Nanoseconds period = 0;
  for (const CameraFeed& feed : feeds_) period = std::max(period, feed.frame_period());
  Triggered result;
  result.called = now();
  cameras_ready_ = result.called + period + period / 50 + core::kMillisecond / 2;
  result.triggered = rig_.trigger->fire();
  if (result.triggered < result.called || result.triggered > now()) {
    throw core::DeviceError("the trigger says that it fired at a time at which it was not asked to");
  }
  return result;
}

void Pass::listen(core::Nanoseconds until, const std::function<void(std::size_t, CameraFrame)>& hear) {
  while (true) {
    bool idle = true;
    for (std::size_t c = 0; c < feeds_.size(); ++c) {
      std::optional<CameraFrame> frame = feeds_[c].next(now());
      if (!frame) continue;
      idle = false;
      hear(c, std::move(*frame));
    }
    if (now() >= until) return;
    if (idle) rig_.clock.sleep_until(std::min(until, now() + kPoll));
  }
}

void Pass::forget_cameras() {
  for (CameraFeed& feed : feeds_) feed.forget();
}

void Pass::keep(const db::Step& step, const CameraFeed& feed, CameraFrame frame) {
  if (!missing(step, feed)) {
    ++report_.discarded;
    return;
  }
  const int attempt = std::max(1, tries(step));
  keeper_.keep({&step, feed.name(), attempt, std::move(frame)});
  stored_.emplace(step.step_index, feed.name());
  ++report_.stored;
  if (attempt > 1) ++report_.retaken;
  show_progress(step);
}

std::size_t Pass::step_bytes() const {
  std::size_t bytes = 0;
  for (const CameraFeed& feed : feeds_) bytes += feed.picture_bytes();
  return bytes;
}

std::size_t Pass::steps_together(std::size_t most) const {
  return std::clamp<std::size_t>(kMostBytesTogether / std::max<std::size_t>(1, step_bytes()), 1, most);
}

void Pass::check_lights() {
  lights_status_ = rig_.lights.status();
  if (lights_status_.faults.empty()) return;
  throw core::DeviceError("the LED controller switched lights off by itself: " +
                          core::joined(lights_status_.faults, "; "));
}

void Pass::show_progress(const db::Step& step) {
  const double seconds = static_cast<double>(now() - begin_) / static_cast<double>(core::kSecond);
  char rate[32] = "", temperature[32] = "";
  if (seconds > 0) std::snprintf(rate, sizeof rate, ", %.1f frames/s", static_cast<double>(report_.stored) / seconds);
  if (const std::optional<double> celsius = lights_status_.temperature_celsius) {
    std::snprintf(temperature, sizeof temperature, ", LEDs at %.0f C", *celsius);
  }
  progress_.set_status(describe(step) + rate + ", " + std::to_string(report_.dropped) + " dropped, " +
                       std::to_string(report_.retaken) + " retaken" + temperature);
  progress_.advance();
}

void Pass::give_up(const db::Step& step, const CameraFeed& feed, const std::string& trouble) const {
  throw core::DeviceError("camera '" + feed.name() + "' gave no good frame of " + describe(step) + " in " +
                          std::to_string(options_.attempts) + " tries: " + trouble +
                          "; what was stored is kept, check the device and resume");
}

}  // namespace lightstage::capture
