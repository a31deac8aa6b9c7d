#include "hil/scenarios/timed_rig.h"

namespace lightstage::hil {

struct TimedRig::Camera : capture::Camera {
  Camera(capture::Camera& the_inner, const core::Clock& the_clock) : inner(the_inner), clock(the_clock) {}

  std::string name() const override { return inner.name(); }
  void set_exposure(core::Nanoseconds exposure) override { inner.set_exposure(exposure); }
  void set_exposing(capture::Exposing exposing) override { inner.set_exposing(exposing); }
  core::Nanoseconds frame_period() const override { return inner.frame_period(); }
  std::optional<capture::CameraFrame> wait_frame(core::Nanoseconds deadline) override {
    std::optional<capture::CameraFrame> frame = inner.wait_frame(deadline);
    if (frame && !fired.empty()) {
      total += clock.now() - fired.front();
      ++frames;
      fired.pop_front();
    }
    return frame;
  }

  capture::Camera& inner;
  const core::Clock& clock;
  std::deque<core::Nanoseconds> fired;  // triggers whose frame has not come
  core::Nanoseconds total = 0;
  int frames = 0;
};

struct TimedRig::Trigger : capture::Trigger {
  Trigger(capture::Trigger& the_inner, const core::Clock& the_clock, std::vector<std::shared_ptr<Camera>>& the_cameras)
      : inner(the_inner), clock(the_clock), cameras(the_cameras) {}

  core::Nanoseconds fire() override {
    for (const auto& camera : cameras) camera->fired.push_back(clock.now());
    return inner.fire();
  }

  capture::Trigger& inner;
  const core::Clock& clock;
  std::vector<std::shared_ptr<Camera>>& cameras;
};

TimedRig::TimedRig(const capture::Rig& rig) : inner_(rig) {
  for (capture::Camera* camera : rig.cameras) {
    cameras_.push_back(std::make_shared<Camera>(*camera, rig.clock));
    pointers_.push_back(cameras_.back().get());
  }
  if (rig.trigger) trigger_ = std::make_shared<Trigger>(*rig.trigger, rig.clock, cameras_);
}

capture::Rig TimedRig::rig() {
  return {.lights = inner_.lights,
          .trigger = trigger_.get(),
          .cameras = pointers_,
          .clock = inner_.clock,
          .strobe = inner_.strobe};
}

double TimedRig::mean_latency_ms() const {
  core::Nanoseconds total = 0;
  int frames = 0;
  for (const auto& camera : cameras_) {
    total += camera->total;
    frames += camera->frames;
  }
  return frames > 0 ? static_cast<double>(total) / 1e6 / frames : 0;
}

}  // namespace lightstage::hil
