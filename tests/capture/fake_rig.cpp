#include "fake_rig.h"

#include <algorithm>
#include <limits>

#include "core/error.h"

namespace lightstage::test {

class FakeRig::Lights : public capture::LedController, public capture::PatternPlayer {
 public:
  explicit Lights(FakeRig& rig) : rig_(rig) {}
  std::size_t light_count() const override { return rig_.light_count_; }

  void show(std::span<const capture::LightLevel> levels) override {
    playing_ = false;
    if (rig_.show_failures.contains(rig_.show_calls_++)) throw core::DeviceError("fake LEDs: no answer");
    rig_.clock_.sleep_until(rig_.clock_.now() + rig_.command_time / 2);
    rig_.shown_.emplace_back(levels.begin(), levels.end());
    rig_.change_lights(rig_.clock_.now(), rig_.shown_.back());
    rig_.clock_.sleep_until(rig_.clock_.now() + rig_.command_time / 2);
  }

  void all_off() override {
    playing_ = false;
    if (rig_.all_off_calls_++ < rig_.all_off_failures) throw core::DeviceError("fake LEDs: deaf");
    rig_.change_lights(rig_.clock_.now(), {});
  }

  capture::PatternPlayer* player() override { return rig_.holds_sequences ? this : nullptr; }

  void load(std::span<const std::vector<capture::LightLevel>> patterns) override {
    patterns_.assign(patterns.begin(), patterns.end());
  }

  void arm(std::size_t first, core::Nanoseconds delay) override {
    playing_ = true;
    at_ = first;
    delay_ = delay;
    step_times_.clear();
    rig_.change_lights(rig_.clock_.now(), patterns_.at(first));
  }

  std::size_t position() override {
    step_until(rig_.clock_.now());
    return at_;
  }

  std::optional<core::Nanoseconds> wait_for_pattern(std::size_t index, core::Nanoseconds deadline) override {
    while (at_ < index) {
      if (step_times_.empty() || step_times_.front() > deadline) {
        rig_.clock_.sleep_until(deadline);
        return std::nullopt;
      }
      rig_.clock_.sleep_until(step_times_.front());
      step_until(step_times_.front());
    }
    return rig_.clock_.now();
  }

  // A strobe that bounces is heard twice.
  void exposure_ends(core::Nanoseconds time, bool bounces) {
    if (!playing_) return;
    step_times_.push_back(time + rig_.strobe_time + delay_);
    if (bounces) step_times_.push_back(step_times_.back() + core::kMillisecond / 20);
  }

  void step_until(core::Nanoseconds time) {
    for (; !step_times_.empty() && step_times_.front() <= time; step_times_.pop_front()) {
      if (at_ < patterns_.size()) ++at_;
      rig_.change_lights(step_times_.front(),
                         at_ < patterns_.size() ? patterns_[at_] : std::vector<capture::LightLevel>{});
    }
  }

 private:
  FakeRig& rig_;
  std::vector<std::vector<capture::LightLevel>> patterns_;
  bool playing_ = false;
  std::size_t at_ = 0;
  core::Nanoseconds delay_ = 0;
  std::deque<core::Nanoseconds> step_times_;
};

class FakeRig::Camera : public capture::Camera {
 public:
  Camera(FakeRig& rig, std::size_t index) : rig_(rig), index_(index) {}
  std::string name() const override { return "fake" + std::to_string(index_); }
  void set_exposure(core::Nanoseconds exposure) override {
    run_until(rig_.clock_.now());
    exposure_ = exposure;
  }
  void set_exposing(capture::Exposing exposing) override {
    free_ = exposing == capture::Exposing::kFreeRunning;
    next_start_ = rig_.clock_.now() + static_cast<core::Nanoseconds>(index_) * rig_.phase_of_camera;
  }
  core::Nanoseconds frame_period() const override { return std::max(exposure_, rig_.least_period); }

  void expose(int exposure_number, core::Nanoseconds triggered) {
    const Delivery script = rig_.delivery(index_, exposure_number);
    if (free_ || script.swallowed || triggered < busy_until_) return;
    expose(script, triggered + script.start_delay);
    if (index_ == 0 && !rig_.strobe_failures.contains(exposure_number)) {
      rig_.lights_->exposure_ends(triggered + script.start_delay + exposure_,
                                  rig_.strobe_bounces.contains(exposure_number));
    }
  }

  std::optional<capture::CameraFrame> wait_frame(core::Nanoseconds deadline) override {
    run_until(deadline);
    // Drivers deliver in the order in which frames become ready.
    const auto next = std::min_element(queue_.begin(), queue_.end(),
                                       [](const Queued& a, const Queued& b) { return a.ready < b.ready; });
    if (next == queue_.end() || next->ready > deadline) {
      rig_.clock_.sleep_until(deadline);
      return std::nullopt;
    }
    rig_.clock_.sleep_until(next->ready);
    rig_.lights_->step_until(rig_.clock_.now());
    Queued taken = std::move(*next);
    queue_.erase(next);
    if (taken.raises_device_error) throw core::DeviceError("fake camera: unplugged");
    const bool mixed = taken.exposure_end < taken.begin;  // one added by hand
    if (!taken.frame.damaged) {
      taken.frame.image = picture(mixed ? kMixed : rig_.value_between(taken.begin, taken.exposure_end));
    }
    return std::move(taken.frame);
  }

  void add(std::int64_t sequence_number, core::Nanoseconds timestamp, bool damaged) {
    queue_.push_back({make_frame(sequence_number, timestamp, damaged), timestamp, timestamp - 1, timestamp, false});
  }

 private:
  struct Queued {
    capture::CameraFrame frame;
    core::Nanoseconds begin = 0, exposure_end = 0, ready = 0;
    bool raises_device_error = false;
  };

  void expose(const Delivery& script, core::Nanoseconds start) {
    const core::Nanoseconds end = start + exposure_;
    for (int i = 0; i < script.copies; ++i) {
      queue_.push_back({make_frame(sequence_number_, start + script.stamp_late, script.damaged), start, end,
                        end + script.late, script.raises_device_error});
    }
    ++sequence_number_;
    busy_until_ = start + std::max(exposure_, rig_.least_period);
  }

  // The exposures of a camera that runs free, up to this time.
  void run_until(core::Nanoseconds time) {
    while (free_ && exposure_ > 0 && next_start_ <= time) {
      expose(rig_.delivery(index_, free_exposures_++), next_start_);
      next_start_ += frame_period();
    }
  }

  core::Image picture(float value) const {
    core::Image image(2, 3, 1);
    std::fill(image.values().begin(), image.values().end(), value);
    if (!rig_.pictures_are_finite) image(1, 1) = std::numeric_limits<float>::quiet_NaN();
    return image;
  }

  capture::CameraFrame make_frame(std::int64_t sequence_number, core::Nanoseconds stamp, bool damaged) const {
    return {picture(kDamaged), 4000, sequence_number, stamp, damaged};
  }

  FakeRig& rig_;
  std::size_t index_;
  core::Nanoseconds exposure_ = 0, busy_until_ = 0, next_start_ = 0;
  bool free_ = false;
  int free_exposures_ = 0;
  std::int64_t sequence_number_ = 100;
  std::deque<Queued> queue_;
};

class FakeRig::Trigger : public capture::Trigger {
 public:
  explicit Trigger(FakeRig& rig) : rig_(rig) {}
  core::Nanoseconds fire() override {
    rig_.on_fire(rig_.exposures_);
    const auto part = rig_.fire_time / static_cast<core::Nanoseconds>(rig_.cameras_.size());
    core::Nanoseconds time = rig_.clock_.now();
    for (const auto& camera : rig_.cameras_) {
      camera->expose(rig_.exposures_, time);
      time += part;
    }
    rig_.clock_.sleep_until(rig_.clock_.now() + rig_.fire_time);
    ++rig_.exposures_;
    return rig_.clock_.now();
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

void FakeRig::change_lights(core::Nanoseconds time, std::vector<capture::LightLevel> levels) {
  changes_.push_back({time, std::move(levels)});
}

float FakeRig::value_between(core::Nanoseconds begin, core::Nanoseconds end) const {
  float value = 0;
  double sum = 0;
  bool mixed = false;
  core::Nanoseconds since = begin;
  for (const Change& change : changes_) {
    const float next = value_for(change.levels, light_count_);
    if (change.time > begin && change.time < end && next != value) {
      mixed = true;
      sum += static_cast<double>(value) * static_cast<double>(change.time - since);
      since = change.time;
    }
    if (change.time < end || change.time <= begin) value = next;
  }
  if (!mixed) return value;
  sum += static_cast<double>(value) * static_cast<double>(end - since);
  return static_cast<float>(sum / static_cast<double>(end - begin)) + kMixture;
}

}  // namespace lightstage::test
