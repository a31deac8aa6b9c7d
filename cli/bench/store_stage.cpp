#include "cli/bench/store_stage.h"

#include <algorithm>
#include <deque>
#include <optional>

#include "capture/stage.h"
#include "core/error.h"
#include "sim/sensor.h"
#include "sim/world.h"

namespace lightstage::cli {

namespace {

constexpr core::Nanoseconds kTransfer = 4 * core::kMillisecond;  // from the end of an exposure to its frame
constexpr core::Nanoseconds kSceneExposure = 20 * core::kMillisecond;
constexpr int kRoundShift = 131;  // rows

sim::Simulation scene(const StoreStageOptions& options) {
  capture::LayoutOptions layout;
  layout.lights = 32;
  layout.cameras = options.cameras;
  layout.camera_pixels = std::max(16, options.height);
  sim::Simulation simulation;
  simulation.stage = capture::make_stage("bench", layout);
  for (capture::StageCamera& camera : simulation.stage.cameras) {
    camera.model.cx += (options.width - camera.model.width) / 2.0;
    camera.model.cy += (options.height - camera.model.height) / 2.0;
    camera.model.width = options.width;
    camera.model.height = options.height;
  }
  simulation.motion.amplitude_m = 0;
  simulation.pixel_samples = 1;
  simulation.sensor.bits = 16;
  return simulation;
}

// Each camera's picture twice, one above the other: any run of `height` rows is one with its rows moved round.
std::vector<core::Image> render_views(const StoreStageOptions& options) {
  const sim::World world(scene(options));
  std::vector<core::Image> views;
  for (std::size_t c = 0; c < std::size_t(options.cameras); ++c) {
    const capture::StageCamera& camera = world.simulation().stage.cameras[c];
    const std::vector<capture::LightLevel> lit{{int(3 * c % 32)}};
    const core::Image view = sim::sense(core::to_luminance(world.render(camera.model, lit, 0)),
                                        world.simulation().sensor, camera.responsivity, kSceneExposure, c + 1);
    core::Image doubled(2 * view.height(), view.width(), 1);
    std::copy(view.values().begin(), view.values().end(), doubled.values().begin());
    std::copy(view.values().begin(), view.values().end(),
              doubled.values().begin() + std::ptrdiff_t(view.values().size()));
    views.push_back(std::move(doubled));
  }
  return views;
}

}  // namespace

struct StoreStage::Impl {
  Impl(const StoreStageOptions& o, core::Clock& c)
      : options(o), clock(c), views(render_views(o)), lights(*this), trigger(*this) {
    for (std::size_t i = 0; i < views.size(); ++i) {
      cameras.push_back(std::make_unique<Camera>(*this, i));
      pointers.push_back(cameras.back().get());
    }
  }

  struct Lights : capture::LedController {
    explicit Lights(Impl& s) : stage(s) {}
    std::size_t light_count() const override { return stage.options.lights; }
    void show(std::span<const capture::LightLevel> levels) override {
      stage.lit = levels.size() == 1 ? std::optional(levels[0].light_index) : std::nullopt;
    }
    void all_off() override { stage.lit.reset(); }
    Impl& stage;
  };

  struct Trigger : capture::Trigger {
    explicit Trigger(Impl& s) : stage(s) {}
    core::Nanoseconds fire() override {
      const core::Nanoseconds now = stage.clock.now();
      for (const auto& camera : stage.cameras) camera->expose(now);
      return now;
    }
    Impl& stage;
  };

  class Camera : public capture::Camera {
   public:
    Camera(Impl& stage, std::size_t index) : stage_(stage), index_(index) {}
    std::string name() const override { return "cam" + std::to_string(index_); }
    void set_exposure(core::Nanoseconds exposure) override { exposure_ = exposure; }
    void set_exposing(capture::Exposing exposing) override {
      if (exposing != capture::Exposing::kTriggered) throw core::DeviceError(name() + " has no other mode");
    }
    core::Nanoseconds frame_period() const override {
      return std::max(exposure_, core::Nanoseconds(double(core::kSecond) / stage_.options.frames_per_s));
    }

    void expose(core::Nanoseconds now) {
      if (now < busy_until_) return;  // misses the trigger, as real ones do
      busy_until_ = now + frame_period();
      exposed_.push_back({now, exposure_, ++number_, stage_.lit});
    }

    std::optional<capture::CameraFrame> wait_frame(core::Nanoseconds deadline) override {
      if (exposed_.empty() || exposed_.front().start + exposed_.front().exposure + kTransfer > deadline) {
        stage_.clock.sleep_until(deadline);
        return std::nullopt;
      }
      const Exposed exposed = exposed_.front();
      exposed_.pop_front();
      stage_.clock.sleep_until(exposed.start + exposed.exposure + kTransfer);
      capture::CameraFrame frame;
      frame.image = exposed.light ? stage_.picture(index_, *exposed.light)
                                  : core::Image(stage_.options.height, stage_.options.width, 1);
      frame.saturation = 1;
      frame.sequence_number = exposed.number;
      frame.timestamp = exposed.start;
      return frame;
    }

   private:
    struct Exposed {
      core::Nanoseconds start = 0, exposure = 0;
      std::int64_t number = 0;
      std::optional<int> light;
    };
    Impl& stage_;
    std::size_t index_;
    core::Nanoseconds exposure_ = 0, busy_until_ = 0;
    std::int64_t number_ = 0;
    std::deque<Exposed> exposed_;
  };

  core::Image picture(std::size_t camera, int light) const {
    const int shift = (light + round * kRoundShift) % options.height;
    return core::Image(views[camera].view().crop(shift, 0, options.height, options.width));
  }

  StoreStageOptions options;
  core::Clock& clock;
  std::vector<core::Image> views;
  std::optional<int> lit;
  int round = 0;
  Lights lights;
  Trigger trigger;
  std::vector<std::unique_ptr<Camera>> cameras;
  std::vector<capture::Camera*> pointers;
};

StoreStage::StoreStage(const StoreStageOptions& options, core::Clock& clock)
    : impl_(std::make_unique<Impl>(options, clock)) {}
StoreStage::~StoreStage() = default;

capture::Rig StoreStage::rig() {
  return {impl_->lights, &impl_->trigger, impl_->pointers, impl_->clock};
}

std::vector<std::string> StoreStage::camera_names() const {
  std::vector<std::string> names;
  for (const auto& camera : impl_->cameras) names.push_back(camera->name());
  return names;
}

void StoreStage::begin_round(int round) {
  impl_->round = round;
}

core::Image StoreStage::picture(std::size_t camera, int light) const {
  return impl_->picture(camera, light);
}

}  // namespace lightstage::cli
