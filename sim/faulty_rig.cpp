#include "sim/faulty_rig.h"

#include <deque>
#include <limits>
#include <map>
#include <vector>

#include "core/error.h"
#include "sim/scene/random.h"

namespace lightstage::sim {

namespace {

using capture::CameraFrame;
using core::Nanoseconds;

constexpr Nanoseconds kTimeOut = 400 * core::kMillisecond, kOutage = core::kSecond;
constexpr Nanoseconds kNonsenseTime = 3600LL * 24 * 365 * core::kSecond;
constexpr std::size_t kRemembered = 4;  // frames of which stale ones are taken

bool is_of_frames(DeviceFault fault) {
  return fault == DeviceFault::kNotANumber || fault == DeviceFault::kWrongSize || fault == DeviceFault::kStale ||
         fault == DeviceFault::kDuplicate;
}

core::Image noise(core::ImageSize size, std::uint64_t seed) {
  core::Image image(size);
  for (std::size_t i = 0; i < image.values().size(); ++i) image.values()[i] = float(uniform(mix(seed, i), 0));
  return image;
}

}  // namespace

std::string_view to_string(DeviceCall call) {
  static constexpr std::array<std::string_view, kDeviceCalls.size()> kNames{
      "show", "all_off",      "status",       "load",         "arm",       "position", "wait_for_pattern",
      "fire", "set_exposure", "set_exposing", "frame_period", "wait_frame"};
  return kNames.at(std::size_t(call));
}

std::string_view to_string(DeviceFault fault) {
  static constexpr std::array<std::string_view, kDeviceFaults.size()> kNames{
      "time-out", "answer lost", "garbage",   "not a number", "wrong size",
      "short",    "stale",       "duplicate", "vanish",       "vanish for good"};
  return kNames.at(std::size_t(fault));
}

bool can_befall(DeviceFault fault, DeviceCall call) {
  if (is_of_frames(fault)) return call == DeviceCall::kWaitFrame;
  if (fault == DeviceFault::kShort) return call == DeviceCall::kWaitFrame || call == DeviceCall::kFire;
  if (fault == DeviceFault::kGarbage) {
    return call == DeviceCall::kStatus || call == DeviceCall::kPosition || call == DeviceCall::kWaitForPattern ||
           call == DeviceCall::kFire || call == DeviceCall::kFramePeriod || call == DeviceCall::kWaitFrame;
  }
  return true;
}

struct FaultyRig::Impl {
  Impl(const capture::Rig& the_rig, Plan the_plan)
      : inner(the_rig), plan(std::move(the_plan)), lights(*this), trigger(*this) {
    for (capture::Camera* camera : inner.cameras) cameras.push_back(std::make_unique<Camera>(*this, *camera));
    for (const auto& camera : cameras) camera_pointers.push_back(camera.get());
  }

  // One of the devices, which may be gone.
  struct Device {
    std::string name;
    Nanoseconds gone_until = 0;
    bool was_gone = false;  // a camera: what it exposed meanwhile is to be lost
  };

  [[noreturn]] void time_out(const Device& device) {
    inner.clock.sleep_until(inner.clock.now() + kTimeOut);
    throw core::DeviceError(device.name + ": no answer");
  }
  void require(const Device& device) const {
    if (inner.clock.now() < device.gone_until) throw core::DeviceError(device.name + ": it is gone");
  }

  std::optional<DeviceFault> next_fault(DeviceCall call) {
    const int n = counts[call]++;
    if (mended) return std::nullopt;
    const std::optional<DeviceFault> fault = plan(call, n);
    if (!fault || !can_befall(*fault, call)) return std::nullopt;
    ++injected;
    return fault;
  }

  void vanish(Device& device, DeviceFault fault) {
    device.gone_until =
        fault == DeviceFault::kVanish ? inner.clock.now() + kOutage : std::numeric_limits<Nanoseconds>::max();
    device.was_gone = true;
    // A controller whose cable is pulled goes dark at once.
    if (&device == &lights.device) inner.lights.all_off();
    require(device);
  }

  // What every call has in common; the faults that are its own are returned.
  template <class Do>
  std::optional<DeviceFault> call(Device& device, DeviceCall which, const Do& carry_out) {
    require(device);
    const std::optional<DeviceFault> fault = next_fault(which);
    if (!fault) return std::nullopt;
    switch (*fault) {
      case DeviceFault::kTimeOut:
        time_out(device);
      case DeviceFault::kAnswerLost:
        carry_out();
        time_out(device);
      case DeviceFault::kVanish:
      case DeviceFault::kVanishForGood:
        vanish(device, *fault);
        break;
      default:
        break;
    }
    return fault;
  }

  class Lights : public capture::LedController, public capture::PatternPlayer {
   public:
    explicit Lights(Impl& impl) : impl_(impl) {}
    std::size_t light_count() const override { return impl_.inner.lights.light_count(); }
    void show(std::span<const capture::LightLevel> levels) override {
      const auto carry_out = [&] { impl_.inner.lights.show(levels); };
      impl_.call(device, DeviceCall::kShow, carry_out);
      carry_out();
    }
    void all_off() override {
      const auto carry_out = [&] { impl_.inner.lights.all_off(); };
      impl_.call(device, DeviceCall::kAllOff, carry_out);
      carry_out();
    }
    capture::LedStatus status() override {
      const auto fault = impl_.call(device, DeviceCall::kStatus, [&] { impl_.inner.lights.status(); });
      capture::LedStatus status = impl_.inner.lights.status();
      if (fault)
        status = {.temperature_celsius = std::numeric_limits<double>::quiet_NaN(),
                  .supply_volts = -1e300,
                  .faults = {"\x01nonsense"}};
      return status;
    }
    capture::PatternPlayer* player() override { return inner() ? this : nullptr; }

    void load(std::span<const std::vector<capture::LightLevel>> patterns) override {
      const auto carry_out = [&] { inner()->load(patterns); };
      impl_.call(device, DeviceCall::kLoad, carry_out);
      carry_out();
    }
    void arm(std::size_t first, Nanoseconds delay) override {
      const auto carry_out = [&] { inner()->arm(first, delay); };
      impl_.call(device, DeviceCall::kArm, carry_out);
      carry_out();
    }
    std::size_t position() override {
      const auto fault = impl_.call(device, DeviceCall::kPosition, [&] { inner()->position(); });
      const std::size_t position = inner()->position();
      return fault ? position + 1 + std::size_t(impl_.injected) % 7 : position;
    }
    std::optional<Nanoseconds> wait_for_pattern(std::size_t index, Nanoseconds deadline) override {
      const auto fault =
          impl_.call(device, DeviceCall::kWaitForPattern, [&] { inner()->wait_for_pattern(index, deadline); });
      // It says at once that it was long ago, or will be long from now.
      if (fault) return impl_.inner.clock.now() + (impl_.injected % 2 == 0 ? kNonsenseTime : -kNonsenseTime);
      return inner()->wait_for_pattern(index, deadline);
    }

    Device device{"LED controller", 0};

   private:
    capture::PatternPlayer* inner() { return impl_.inner.lights.player(); }
    Impl& impl_;
  };

  class Trigger : public capture::Trigger {
   public:
    explicit Trigger(Impl& impl) : impl_(impl) {}
    Nanoseconds fire() override {
      const auto fault = impl_.call(device, DeviceCall::kFire, [&] { impl_.inner.trigger->fire(); });
      if (fault == DeviceFault::kShort) return impl_.inner.clock.now();
      const Nanoseconds fired = impl_.inner.trigger->fire();
      if (!fault) return fired;
      return impl_.injected % 2 == 0 ? kNonsenseTime : -kNonsenseTime;
    }

    Device device{"trigger", 0};

   private:
    Impl& impl_;
  };

  class Camera : public capture::Camera {
   public:
    Camera(Impl& impl, capture::Camera& inner)
        : device{"camera '" + inner.name() + "'", 0}, impl_(impl), inner_(inner) {}
    std::string name() const override { return inner_.name(); }
    std::optional<core::ImageSize> frame_size() const override { return inner_.frame_size(); }
    void set_exposure(Nanoseconds exposure) override {
      const auto carry_out = [&] { inner_.set_exposure(exposure); };
      impl_.call(device, DeviceCall::kSetExposure, carry_out);
      carry_out();
    }
    void set_exposing(capture::Exposing exposing) override {
      const auto carry_out = [&] { inner_.set_exposing(exposing); };
      impl_.call(device, DeviceCall::kSetExposing, carry_out);
      carry_out();
    }
    Nanoseconds frame_period() const override {
      const auto fault = impl_.call(device, DeviceCall::kFramePeriod, [] {});
      if (fault) return impl_.injected % 2 == 0 ? kNonsenseTime : -kNonsenseTime;
      return inner_.frame_period();
    }

    std::optional<CameraFrame> wait_frame(Nanoseconds deadline) override {
      impl_.require(device);
      if (device.was_gone) lose_what_came();
      if (!queue_.empty()) return taken(queue_);
      std::optional<CameraFrame> frame = inner_.wait_frame(deadline);
      if (!frame) return std::nullopt;
      const std::optional<DeviceFault> fault = impl_.call(device, DeviceCall::kWaitFrame, [] {});
      const CameraFrame sound = *frame;
      if (fault) disturb(*fault, *frame);
      remembered_.push_back(sound);
      if (remembered_.size() > kRemembered) remembered_.pop_front();
      return frame;
    }

    mutable Device device;

   private:
    static CameraFrame taken(std::deque<CameraFrame>& queue) {
      CameraFrame frame = std::move(queue.front());
      queue.pop_front();
      return frame;
    }

    // It was gone while they were exposed.
    void lose_what_came() {
      device.was_gone = false;
      queue_.clear();
      while (inner_.wait_frame(impl_.inner.clock.now())) {
      }
    }

    void disturb(DeviceFault fault, CameraFrame& frame) {
      const core::ImageSize size = frame.image.size();
      switch (fault) {
        case DeviceFault::kGarbage:
          frame.image = noise(size, std::uint64_t(impl_.injected));
          frame.damaged = true;
          break;
        case DeviceFault::kNotANumber:
          frame.image.values()[frame.image.values().size() / 2] = std::numeric_limits<float>::quiet_NaN();
          break;
        case DeviceFault::kWrongSize:
          frame.image = core::Image(size.height, 2 * size.width, size.channels);
          break;
        case DeviceFault::kShort:
          frame.image = core::Image(frame.image.view().crop(0, 0, (size.height + 1) / 2, size.width));
          break;
        case DeviceFault::kDuplicate:
          queue_.push_back(frame);
          break;
        case DeviceFault::kStale:
          if (remembered_.empty()) break;
          queue_.push_back(frame);
          frame = remembered_[std::size_t(impl_.injected) % remembered_.size()];
          break;
        default:
          break;
      }
    }

    Impl& impl_;
    capture::Camera& inner_;
    std::deque<CameraFrame> queue_, remembered_;
  };

  const capture::Rig inner;
  const Plan plan;
  std::map<DeviceCall, int> counts;
  int injected = 0;
  bool mended = false;
  Lights lights;
  Trigger trigger;
  std::vector<std::unique_ptr<Camera>> cameras;
  std::vector<capture::Camera*> camera_pointers;
};

FaultyRig::FaultyRig(const capture::Rig& rig, Plan plan) : impl_(std::make_unique<Impl>(rig, std::move(plan))) {}
FaultyRig::~FaultyRig() = default;

capture::Rig FaultyRig::rig() {
  return {impl_->lights, impl_->inner.trigger ? &impl_->trigger : nullptr, impl_->camera_pointers, impl_->inner.clock};
}

int FaultyRig::injected() const {
  return impl_->injected;
}

void FaultyRig::mend() {
  impl_->mended = true;
  impl_->lights.device.gone_until = impl_->trigger.device.gone_until = 0;
  for (const auto& camera : impl_->cameras) camera->device.gone_until = 0;
}

}  // namespace lightstage::sim
