#include "sim/rig.h"

#include <algorithm>
#include <deque>
#include <limits>
#include <map>
#include <mutex>

#include "capture/protocol_leds.h"
#include "core/error.h"
#include "sim/devices/led_bank.h"
#include "sim/firmware_link.h"
#include "sim/led_firmware.h"
#include "sim/scene/random.h"
#include "sim/sensor.h"

namespace lightstage::sim {

namespace {

constexpr core::Nanoseconds kShortestExposure = 1000, kLongestExposure = 10 * core::kSecond;

// What random numbers are for: keeps their streams apart, and those of the subject's motion.
enum Purpose : std::uint64_t { kJitter = 0x7269670001, kDrop, kSensor, kPhase, kTransfer };

bool contains(const std::vector<int>& list, int value) {
  return std::find(list.begin(), list.end(), value) != list.end();
}

// The firmware at the end of a link in memory, and the LEDs that it drives.
class SimulatedLights : public capture::LedController {
 public:
  SimulatedLights(const World& world, core::Clock& clock, const DeviceTimes& times, const ControllerLimits& limits)
      : faults_(world.simulation().faults),
        clock_(clock),
        times_(times),
        leds_(world.simulation().stage.light_positions.size(), faults_.rise_time),
        firmware_(options(leds_.light_count(), limits),
                  [this](core::Nanoseconds time, auto lit) { change(time, lit); }) {
    auto link = std::make_unique<FirmwareLink>(firmware_, clock);
    link_ = link.get();
    capture::ProtocolLedsOptions host{.name = "simulated LED controller", .keep_alive = false};
    for (std::size_t i = 0; i < leds_.light_count(); ++i) host.output_of_light.push_back(static_cast<int>(i));
    host_ = std::make_unique<capture::ProtocolLeds>(std::move(link), std::move(host), clock);
  }

  std::size_t light_count() const override { return leds_.light_count(); }

  void show(std::span<const capture::LightLevel> levels) override {
    if (contains(faults_.light_timeouts, shows_++)) throw core::DeviceError("simulated LED controller: no answer");
    clock_.sleep_until(clock_.now() + times_.command / 2);
    host_->show(levels);
    clock_.sleep_until(clock_.now() + times_.command / 2);
  }

  void all_off() override { host_->all_off(); }
  capture::LedStatus status() override { return host_->status(); }
  capture::PatternPlayer* player() override { return host_->player(); }

  void strobe(core::Nanoseconds begin, core::Nanoseconds end) {
    link_->schedule_strobe(true, begin);
    link_->schedule_strobe(false, end);
  }
  // Steps that fell due in the meantime are carried out, each at its own time.
  void catch_up() { link_->catch_up(); }

  LedBank& leds() { return leds_; }

 private:
  static LedFirmwareOptions options(std::size_t outputs, const ControllerLimits& limits) {
    if (outputs > capture::kMaxLedOutputs) {
      throw core::UsageError("a simulated stage has at most " + std::to_string(capture::kMaxLedOutputs) +
                             " lights, this one has " + std::to_string(outputs));
    }
    LedFirmwareOptions options;
    options.identity.outputs = static_cast<std::uint16_t>(outputs);
    // Calibration exposes for long; nothing here gets hot.
    options.identity.duty_per_mille = 1000;
    options.identity.on_time_limit_ms = 0;
    if (limits.heat) {
      options.identity.duty_per_mille = static_cast<std::uint16_t>(std::lround(1000 * limits.heat->duty));
      options.identity.duty_window_ms = static_cast<std::uint32_t>(std::lround(1000 * limits.heat->duty_window_s));
      options.identity.on_time_limit_ms = static_cast<std::uint32_t>(std::lround(1000 * limits.heat->on_time_s));
    }
    options.flashing = limits.flashing;
    // Nobody sends a keep-alive while virtual time is slept through.
    options.host_silence_limit = 24 * 3600 * core::kSecond;
    return options;
  }

  void change(core::Nanoseconds time, std::span<const capture::OutputLevel> lit) {
    std::vector<capture::LightLevel> levels;
    const auto level = [](std::uint16_t value) { return static_cast<float>(value) / 65535.0f; };
    for (const capture::OutputLevel& l : lit) levels.push_back({l.output, level(l.r), level(l.g), level(l.b)});
    leds_.show(time, levels);
  }

  const FaultSpec& faults_;
  core::Clock& clock_;
  DeviceTimes times_;
  LedBank leds_;
  LedFirmware firmware_;
  FirmwareLink* link_ = nullptr;  // belongs to host_
  std::unique_ptr<capture::ProtocolLeds> host_;
  int shows_ = 0;
};

class SimulatedCamera : public capture::Camera {
 public:
  SimulatedCamera(const World& world, std::size_t camera_index, SimulatedLights& lights, core::Clock& clock,
                  const DeviceTimes& times)
      : world_(world),
        camera_(world.simulation().stage.cameras[camera_index]),
        camera_index_(camera_index),
        lights_(lights),
        clock_(clock),
        times_(times) {
    set_free(!times_.triggered);
  }

  std::string name() const override { return camera_.name; }
  std::optional<core::ImageSize> frame_size() const override {
    return core::ImageSize{camera_.model.height, camera_.model.width, 3};
  }

  void set_exposure(core::Nanoseconds exposure) override {
    if (exposure < kShortestExposure || exposure > kLongestExposure) {
      throw core::DeviceError("simulated camera '" + camera_.name + "': exposures are 0.001 to 10000 ms, not " +
                              std::to_string(static_cast<double>(exposure) / 1e6));
    }
    run_until(clock_.now());
    if (exposure_ == 0) next_start_ = std::max(next_start_, clock_.now());
    exposure_ = exposure;
  }

  void set_exposing(capture::Exposing exposing) override {
    if (times_.triggered) set_free(exposing == capture::Exposing::kFreeRunning);
  }

  core::Nanoseconds frame_period() const override { return std::max(exposure_, times_.shortest_period); }

  void trigger(int exposure_number) {
    if (exposure_ == 0) throw core::DeviceError("simulated camera '" + camera_.name + "': no exposure time was set");
    const core::Nanoseconds now = clock_.now();
    if (free_ || now < busy_until_) return;
    const core::Nanoseconds start = now + delay(now);
    expose(start, now, exposure_number);
    if (camera_index_ == 0) lights_.strobe(start, start + exposure_);
  }

  std::optional<capture::CameraFrame> wait_frame(core::Nanoseconds deadline) override {
    run_until_frame(deadline);
    if (pending_.empty() || pending_.front().ready > deadline) {
      clock_.sleep_until(deadline);
      return std::nullopt;
    }
    const Pending pending = pending_.front();
    pending_.pop_front();
    clock_.sleep_until(pending.ready);
    lights_.catch_up();
    return deliver(pending);
  }

  // No frame that is still to be delivered began before this.
  core::Nanoseconds oldest_pending() const {
    return pending_.empty() ? std::numeric_limits<core::Nanoseconds>::max() : pending_.front().start;
  }

  std::vector<capture::LightLevel> light_in_frame(std::int64_t sequence_number) const {
    const std::lock_guard lock(light_in_frame_mutex_);
    return light_in_frame_.at(sequence_number);
  }

 private:
  struct Pending {
    core::Nanoseconds start = 0, exposure = 0, ready = 0;
    std::int64_t sequence_number = 0;
    bool damaged = false;
    core::Nanoseconds end() const { return start + exposure; }
  };

  // `number` counts exposures, for the faults that are listed by it.
  void expose(core::Nanoseconds start, core::Nanoseconds now, int number) {
    const double late = uniform(seed_for(kTransfer, now), 0) * static_cast<double>(times_.transfer_jitter);
    const core::Nanoseconds ready = start + exposure_ + times_.transfer + std::llround(late);
    const Pending pending{start, exposure_, ready, sequence_number_++, contains(faults().damage_exposures, number)};
    busy_until_ = start + frame_period();
    if (contains(faults().drop_exposures, number)) return;
    if (uniform(seed_for(kDrop, now), 0) < faults().drop_probability) return;
    pending_.push_back(pending);
    if (contains(faults().duplicate_exposures, number)) pending_.push_back(pending);
  }

  void set_free(bool free) {
    free_ = free;
    const double phase = uniform(seed_for(kPhase, 0), 0);
    next_start_ = clock_.now() + std::llround(phase * static_cast<double>(times_.shortest_period));
  }

  // The exposures of a camera that runs free, up to this time; up to one that gave a frame, where there is none to deliver yet:
  // later ones may be of another length.
  void run_until(core::Nanoseconds time) {
    while (free_ && exposure_ > 0 && next_start_ <= time) expose_freely();
  }
  void run_until_frame(core::Nanoseconds time) {
    while (free_ && exposure_ > 0 && next_start_ <= time && pending_.empty()) expose_freely();
  }
  void expose_freely() {
    expose(next_start_, next_start_, free_exposures_++);
    next_start_ += frame_period();
  }

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

  capture::CameraFrame deliver(const Pending& pending) {
    std::vector<capture::LightLevel> levels = lights_.leds().mean_levels(pending.start, pending.end());
    const core::Image radiance = world_.render(camera_.model, levels, pending.start + pending.exposure / 2);
    {
      const std::lock_guard lock(light_in_frame_mutex_);
      light_in_frame_[pending.sequence_number] = std::move(levels);
    }
    capture::CameraFrame frame;
    frame.image = sense(radiance, world_.simulation().sensor, camera_.responsivity, pending.exposure,
                        seed_for(kSensor, pending.start));
    frame.saturation = saturation_radiance(camera_.responsivity, pending.exposure);
    frame.sequence_number = pending.sequence_number;
    frame.timestamp = times_.stamped_on_arrival ? pending.ready : pending.start;
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
  SimulatedLights& lights_;
  core::Clock& clock_;
  DeviceTimes times_;
  core::Nanoseconds exposure_ = 0, busy_until_ = 0, next_start_ = 0;
  bool free_ = false;
  int free_exposures_ = 0;
  std::int64_t sequence_number_ = 0;
  mutable std::mutex light_in_frame_mutex_;  // asked for on the thread that keeps frames
  std::map<std::int64_t, std::vector<capture::LightLevel>> light_in_frame_;
  std::deque<Pending> pending_;
};

}  // namespace

struct SimulatedRig::Impl : capture::Trigger {
  Impl(const World& world, core::Clock& the_clock, const DeviceTimes& times, const ControllerLimits& limits)
      : clock(the_clock), lights(world, the_clock, times, limits) {
    for (std::size_t i = 0; i < world.simulation().stage.cameras.size(); ++i) {
      cameras.push_back(std::make_unique<SimulatedCamera>(world, i, lights, the_clock, times));
      camera_pointers.push_back(cameras.back().get());
    }
  }

  core::Nanoseconds fire() override {
    core::Nanoseconds oldest = clock.now();
    for (const auto& camera : cameras) oldest = std::min(oldest, camera->oldest_pending());
    lights.catch_up();
    lights.leds().forget_before(oldest);
    for (const auto& camera : cameras) camera->trigger(exposures);
    ++exposures;
    return clock.now();
  }

  core::Clock& clock;
  SimulatedLights lights;
  std::vector<std::unique_ptr<SimulatedCamera>> cameras;
  std::vector<capture::Camera*> camera_pointers;
  int exposures = 0;
};

SimulatedRig::SimulatedRig(const World& world, core::Clock& clock, const DeviceTimes& times,
                           const ControllerLimits& limits)
    : impl_(std::make_unique<Impl>(world, clock, times, limits)) {}
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

std::vector<capture::LightLevel> SimulatedRig::light_in_frame(std::size_t camera_index,
                                                              std::int64_t sequence_number) const {
  return impl_->cameras.at(camera_index)->light_in_frame(sequence_number);
}

}  // namespace lightstage::sim
