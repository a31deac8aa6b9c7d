#include "fake_rig.h"

#include <algorithm>
#include <limits>

#include "core/error.h"

namespace lightstage::test {

class FakeRig::Lights : public capture::LedController {
 public:
  explicit Lights(FakeRig& rig) : rig_(rig) {}
  std::size_t light_count() const override { return rig_.light_count_; }
  void show(std::span<const capture::LightLevel> levels) override {
    if (rig_.show_failures.contains(rig_.show_calls_++)) throw core::DeviceError("fake LEDs: no answer");
    rig_.shown_.emplace_back(levels.begin(), levels.end());
    rig_.lights_change(rig_.shown_.back());
  }
  void all_off() override {
    if (rig_.all_off_calls_++ < rig_.all_off_failures) throw core::DeviceError("fake LEDs: deaf");
    rig_.lights_change({});
  }

 private:
  FakeRig& rig_;
};

class FakeRig::Camera : public capture::Camera {
 public:
  Camera(FakeRig& rig, std::size_t index) : rig_(rig), index_(index) {}
  std::string name() const override { return "fake" + std::to_string(index_); }
  void set_exposure(core::Nanoseconds exposure) override { exposure_ = exposure; }
  void set_exposing(capture::Exposing) override {}
  core::Nanoseconds frame_period() const override { return exposure_; }

  void expose(int exposure_number) {
    const Delivery script = rig_.delivery(index_, exposure_number);
    const core::Nanoseconds start = rig_.clock_.now() + script.start_delay, end = start + exposure_;
    const float value = value_for(rig_.lit_, rig_.light_count_);
    for (int i = 0; i < script.copies; ++i) {
      queue_.push_back({make_frame(value, sequence_number_, start, script.damaged), end, end + script.late,
                        script.raises_device_error});
    }
    ++sequence_number_;
  }

  std::optional<capture::CameraFrame> wait_frame(core::Nanoseconds deadline) override {
    // Drivers deliver in the order in which frames become ready.
    const auto next = std::min_element(queue_.begin(), queue_.end(),
                                       [](const Queued& a, const Queued& b) { return a.ready < b.ready; });
    if (next == queue_.end() || next->ready > deadline) {
      rig_.clock_.sleep_until(deadline);
      return std::nullopt;
    }
    rig_.clock_.sleep_until(next->ready);
    Queued taken = std::move(*next);
    queue_.erase(next);
    if (taken.raises_device_error) throw core::DeviceError("fake camera: unplugged");
    return std::move(taken.frame);
  }

  void lights_changed() {
    for (Queued& queued : queue_) {
      if (queued.frame.damaged || rig_.clock_.now() >= queued.exposure_end) continue;
      const bool begun = rig_.clock_.now() > queued.frame.timestamp;
      queued.frame.image = picture(begun ? kMixed : value_for(rig_.lit_, rig_.light_count_));
    }
  }

  void add(std::int64_t sequence_number, core::Nanoseconds timestamp, bool damaged) {
    queue_.push_back({make_frame(kMixed, sequence_number, timestamp, damaged), timestamp, timestamp, false});
  }

 private:
  struct Queued {
    capture::CameraFrame frame;
    core::Nanoseconds exposure_end = 0, ready = 0;
    bool raises_device_error = false;
  };

  core::Image picture(float value) const {
    core::Image image(2, 3, 1);
    std::fill(image.values().begin(), image.values().end(), value);
    if (!rig_.pictures_are_finite) image(1, 1) = std::numeric_limits<float>::quiet_NaN();
    return image;
  }

  capture::CameraFrame make_frame(float value, std::int64_t sequence_number, core::Nanoseconds start,
                                  bool damaged) const {
    return {picture(damaged ? kDamaged : value), 4000, sequence_number, start, damaged};
  }

  FakeRig& rig_;
  std::size_t index_;
  core::Nanoseconds exposure_ = 0;
  std::int64_t sequence_number_ = 100;
  std::deque<Queued> queue_;
};

class FakeRig::Trigger : public capture::Trigger {
 public:
  explicit Trigger(FakeRig& rig) : rig_(rig) {}
  void fire() override {
    rig_.on_fire(rig_.exposures_);
    for (const auto& camera : rig_.cameras_) camera->expose(rig_.exposures_);
    ++rig_.exposures_;
  }

 private:
  FakeRig& rig_;
};

float FakeRig::value_for(const std::vector<capture::LightLevel>& levels, std::size_t light_count) {
  if (levels.empty()) return 0;
  if (levels.size() == light_count) return kAllOn;
  // One light gives its number from 1; a pattern the sum of its lights' numbers, weighted.
  float sum = 0;
  for (const capture::LightLevel& l : levels) sum += l.r * static_cast<float>(l.light_index + 1);
  return sum;
}

FakeRig::FakeRig(std::size_t light_count, std::size_t camera_count)
    : light_count_(light_count), lights_(std::make_unique<Lights>(*this)), trigger_(std::make_unique<Trigger>(*this)) {
  for (std::size_t i = 0; i < camera_count; ++i) {
    cameras_.push_back(std::make_unique<Camera>(*this, i));
    camera_pointers_.push_back(cameras_.back().get());
  }
}

FakeRig::~FakeRig() = default;

capture::Rig FakeRig::rig() {
  return {*lights_, trigger_.get(), camera_pointers_, clock_};
}

std::vector<std::string> FakeRig::camera_names() const {
  std::vector<std::string> names;
  for (const auto& camera : cameras_) names.push_back(camera->name());
  return names;
}

void FakeRig::add_stale_frame(std::size_t camera, std::int64_t sequence_number, core::Nanoseconds timestamp,
                              bool damaged) {
  cameras_[camera]->add(sequence_number, timestamp, damaged);
}

void FakeRig::lights_change(std::vector<capture::LightLevel> levels) {
  lit_ = std::move(levels);
  for (const auto& camera : cameras_) camera->lights_changed();
}

}  // namespace lightstage::test
