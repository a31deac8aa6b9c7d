// Alignment of a simulated head that moves through a pass.
#include <catch2/catch.hpp>

#include "align/flow.h"
#include "align/motion_track.h"
#include "align/moving_pictures.h"
#include "align/subject_mask.h"
#include "capture/stage.h"
#include "sim/sensor.h"
#include "sim/world.h"

namespace lightstage::align {

namespace {

constexpr core::Nanoseconds kStep = 50 * core::kMillisecond;
constexpr int kTrackingEvery = 10;

sim::Simulation moving_head() {
  capture::LayoutOptions layout;
  layout.lights = 40;
  layout.camera_pixels = 256;
  sim::Simulation simulation;
  simulation.stage = capture::make_stage("test", layout);
  simulation.subject.kind = sim::SubjectKind::kProceduralHead;
  return simulation;
}

core::Image tracking_frame(const sim::World& world, core::Nanoseconds t, std::uint64_t seed) {
  std::vector<capture::LightLevel> all;
  for (std::size_t i = 0; i < world.simulation().stage.light_positions.size(); ++i) all.push_back({int(i)});
  const capture::StageCamera& camera = world.simulation().stage.cameras.front();
  return sim::sense(world.render(camera.model, all, t), world.simulation().sensor, camera.responsivity,
                    core::kMillisecond, seed);
}

}  // namespace

TEST_CASE("a simulated head is aligned to a fraction of a pixel") {
  const sim::World world(moving_head());
  const capture::StageCamera& camera = world.simulation().stage.cameras.front();
  const core::Nanoseconds key = 40 * kStep;
  const core::Image reference = tracking_frame(world, key, 1);
  const core::Image coverage = world.coverage(camera.model, key);

  const core::Image mask = subject_mask(reference);
  int both = 0, either = 0;
  for (std::size_t i = 0; i < mask.values().size(); ++i) {
    const bool found = mask.values()[i] > 0.5F, true_one = coverage.values()[i] > 0.5F;
    both += found && true_one;
    either += found || true_one;
  }
  CHECK(double(both) > 0.95 * double(either));

  MotionTrack track;
  for (int step = 0; step <= 80; step += kTrackingEvery) {
    track.add(step * kStep, compute_flow(reference, tracking_frame(world, step * kStep, std::uint64_t(step) + 10)));
  }
  for (const int step : {0, 13, 44, 68, 75}) {
    const core::Nanoseconds t = step * kStep;
    const FlowField truth = world.true_flow(camera.model, key, t);
    const FlowField found = track.at(t);
    std::vector<double> errors, motion;
    for (int y = 0; y < coverage.height(); ++y) {
      for (int x = 0; x < coverage.width(); ++x) {
        if (coverage(y, x) < 0.99F || std::isnan(truth(y, x, 0))) continue;
        errors.push_back(std::hypot(double(found(y, x, 0) - truth(y, x, 0)), double(found(y, x, 1) - truth(y, x, 1))));
        motion.push_back(std::hypot(double(truth(y, x, 0)), double(truth(y, x, 1))));
      }
    }
    const auto middle = std::ptrdiff_t(errors.size() / 2);
    std::nth_element(errors.begin(), errors.begin() + middle, errors.end());
    std::nth_element(motion.begin(), motion.begin() + middle, motion.end());
    INFO("step " << step << ": motion " << motion[std::size_t(middle)] << ", error " << errors[std::size_t(middle)]);
    CHECK(errors[std::size_t(middle)] < 0.15);
    CHECK(errors[std::size_t(middle)] < 0.3 * motion[std::size_t(middle)]);
    CHECK(median_motion_px(found, mask) == Approx(motion[std::size_t(middle)]).margin(0.15));

    // The picture under one light, brought to the key frame's pose, against the same light in that pose.
    const std::vector<capture::LightLevel> one_light{{7}};
    const core::Image there = world.render(camera.model, one_light, t);
    const core::Image here = world.render(camera.model, one_light, key);
    const double before = residual(here, there, mask);
    const double after = residual(here, warp(there, found), mask);
    INFO("residual " << before << " before, " << after << " after");
    CHECK(after < before);
    if (motion[std::size_t(middle)] > 1) CHECK(after < 0.5 * before);
  }
}

}  // namespace lightstage::align
