#include "sim/rig.h"

#include <deque>
#include <limits>

#include "core/error.h"
#include "sim/devices/led_bank.h"
#include "sim/scene/random.h"
#include "sim/sensor.h"

namespace lightstage::sim {

namespace {

constexpr core::Nanoseconds kShortestExposure = 1000, kLongestExposure = 10 * core::kSecond;

// What random numbers are for: keeps their streams apart, and those of the subject's motion.
enum Purpose : std::uint64_t { kJitter = 0x7269670001, kDrop, kSensor };

bool contains(const std::vector<int>& list, int value) {
  return std::find(list.begin(), list.end(), value) != list.end();
}

class SimulatedLights : public capture::LedController {
 public:
  SimulatedLights(const World& world, core::Clock& clock)
      : faults_(world.simulation().faults),
        clock_(clock),
        leds_(world.simulation().stage.light_positions.size(), faults_.rise_time) {}

  std::size_t light_count() const override { return leds_.light_count(); }

  void show(std::span<const capture::LightLevel> levels) override {
    if (contains(faults_.light_timeouts, shows_++)) throw core::DeviceError("simulated LED controller: no answer");
    for (const capture::LightLevel& l : levels) check(l);
    leds_.show(clock_.now(), levels);
  }

  void all_off() override { leds_.show(clock_.now(), {}); }

  LedBank& leds() { return leds_; }

 private:
  void check(const capture::LightLevel& l) const {
    const auto good = [](float v) { return v >= 0 && v <= 1; };
    const bool known = l.light_index >= 0 && static_cast<std::size_t>(l.light_index) < leds_.light_count();
    if (!known || !good(l.r) || !good(l.g) || !good(l.b)) {
      throw core::DeviceError("simulated LED controller: cannot show light " + std::to_string(l.light_index) + " at " +
                              std::to_string(l.r) + ", " + std::to_string(l.g) + ", " + std::to_string(l.b));
    }
  }

  const FaultSpec& faults_;
  core::Clock& clock_;
  LedBank leds_;
  int shows_ = 0;
};

class SimulatedCamera : public capture::Camera {
 public:
  SimulatedCamera(const World& world, std::size_t camera_index, const LedBank& leds, core::Clock& clock)
      : world_(world),
        camera_(world.simulation().stage.cameras[camera_index]),
        camera_index_(camera_index),
        leds_(leds),
        clock_(clock) {}

  std::string name() const override { return camera_.name; }

  void set_exposure(core::Nanoseconds exposure) override {
    if (exposure < kShortestExposure || exposure > kLongestExposure) {
      throw core::DeviceError("simulated camera '" + camera_.name + "': exposures are 0.001 to 10000 ms, not " +
                              std::to_string(static_cast<double>(exposure) / 1e6));
    }
    exposure_ = exposure;
  }

  void set_exposing(capture::Exposing) override {}
  core::Nanoseconds frame_period() const override { return exposure_; }

  // A camera that is exposing already misses the trigger, as real ones do.
  void trigger(int exposure_number) {
    if (exposure_ == 0) throw core::DeviceError("simulated camera '" + camera_.name + "': no exposure time was set");
    const core::Nanoseconds now = clock_.now();
    if (now < busy_until_) return;
    const Pending pending{now + delay(now), exposure_, sequence_number_++,
                          contains(faults().damage_exposures, exposure_number)};
    busy_until_ = pending.end();
    if (contains(faults().drop_exposures, exposure_number)) return;
    if (uniform(seed_for(kDrop, now), 0) < faults().drop_probability) return;
    pending_.push_back(pending);
    if (contains(faults().duplicate_exposures, exposure_number)) pending_.push_back(pending);
  }

  std::optional<capture::CameraFrame> wait_frame(core::Nanoseconds deadline) override {
    if (pending_.empty() || pending_.front().end() > deadline) {
      clock_.sleep_until(deadline);
      return std::nullopt;
    }
    const Pending pending = pending_.front();
    pending_.pop_front();
    clock_.sleep_until(pending.end());
    return deliver(pending);
  }

  // No frame that is still to be delivered began before this.
  core::Nanoseconds oldest_pending() const {
    return pending_.empty() ? std::numeric_limits<core::Nanoseconds>::max() : pending_.front().start;
  }

 private:
  struct Pending {
    core::Nanoseconds start = 0, exposure = 0;
    std::int64_t sequence_number = 0;
    bool damaged = false;
    core::Nanoseconds end() const { return start + exposure; }
  };

  const FaultSpec& faults() const { return world_.simulation().faults; }

  // Times name the random numbers, not counters: a pass that is resumed does not repeat the noise or the
  // drops it began with.
  std::uint64_t seed_for(Purpose purpose, core::Nanoseconds time) const {
    const std::uint64_t stream = mix(mix(world_.simulation().seed, purpose), camera_index_);
    return mix(stream, static_cast<std::uint64_t>(time));
  }

  // Jitter about a fixed delay long enough that no exposure begins before its trigger.
  core::Nanoseconds delay(core::Nanoseconds now) const {
    const double jitter = std::max(0.0, 4 + normal(seed_for(kJitter, now), 0));
    return std::llround(jitter * static_cast<double>(faults().trigger_jitter));
  }

  capture::CameraFrame deliver(const Pending& pending) const {
    const core::Image radiance = world_.render(camera_.model, leds_.mean_levels(pending.start, pending.end()),
                                               pending.start + pending.exposure / 2);
    capture::CameraFrame frame;
    frame.image = sense(radiance, world_.simulation().sensor, camera_.responsivity, pending.exposure,
                        seed_for(kSensor, pending.start));
    frame.saturation = saturation_radiance(camera_.responsivity, pending.exposure);
    frame.sequence_number = pending.sequence_number;
    frame.timestamp = pending.start;
    frame.damaged = pending.damaged;
    if (pending.damaged) {
      const std::span<float> values = frame.image.values();
      std::fill(values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end(), 0.0f);
    }
    return frame;
  }

  const World& world_;
  const capture::StageCamera& camera_;
  std::size_t camera_index_;
  const LedBank& leds_;
  core::Clock& clock_;
  core::Nanoseconds exposure_ = 0, busy_until_ = 0;
  std::int64_t sequence_number_ = 0;
  std::deque<Pending> pending_;
};

}  // namespace

struct SimulatedRig::Impl : capture::Trigger {
  Impl(const World& world, core::Clock& the_clock) : clock(the_clock), lights(world, the_clock) {
    for (std::size_t i = 0; i < world.simulation().stage.cameras.size(); ++i) {
      cameras.push_back(std::make_unique<SimulatedCamera>(world, i, lights.leds(), the_clock));
      camera_pointers.push_back(cameras.back().get());
    }
  }

  void fire() override {
    core::Nanoseconds oldest = clock.now();
    for (const auto& camera : cameras) oldest = std::min(oldest, camera->oldest_pending());
    lights.leds().forget_before(oldest);
    for (const auto& camera : cameras) camera->trigger(exposures);
    ++exposures;
  }

  core::Clock& clock;
  SimulatedLights lights;
  std::vector<std::unique_ptr<SimulatedCamera>> cameras;
  std::vector<capture::Camera*> camera_pointers;
  int exposures = 0;
};

SimulatedRig::SimulatedRig(const World& world, core::Clock& clock) : impl_(std::make_unique<Impl>(world, clock)) {}
SimulatedRig::~SimulatedRig() = default;

capture::Rig SimulatedRig::rig() {
  return {impl_->lights, impl_.get(), impl_->camera_pointers, impl_->clock};
}

bool SimulatedRig::any_light_on() const {
  return impl_->lights.leds().any_on();
}

int SimulatedRig::exposures() const {
  return impl_->exposures;
}

}  // namespace lightstage::sim
