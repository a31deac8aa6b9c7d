// Alignment of a simulated head that moves through a pass.
#include <catch2/catch.hpp>

#include "align/agreement.h"
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

sim::Simulation moving_head(std::size_t lights = 40) {
  capture::LayoutOptions layout;
  layout.lights = lights;
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

// Even ellipses where the eyes are in the picture of a head that fills most of it and faces the camera.
void close_eyes(core::Image& picture, const core::Image& subject) {
  int left = subject.width(), right = 0, top = subject.height(), bottom = 0;
  for (int y = 0; y < subject.height(); ++y)
    for (int x = 0; x < subject.width(); ++x) {
      if (subject(y, x) <= 0.5F) continue;
      left = std::min(left, x);
      right = std::max(right, x);
      top = std::min(top, y);
      bottom = std::max(bottom, y);
    }
  const double width = right - left + 1;
  for (const double side : {-1.0, 1.0}) {
    const double eye_x = 0.5 * (left + right) + side * 0.16 * width, eye_y = top + 0.46 * (bottom - top + 1);
    const core::Image open = picture;
    for (int y = top; y <= bottom; ++y)
      for (int x = left; x <= right; ++x) {
        if (std::hypot((x - eye_x) / (0.077 * width), (y - eye_y) / (0.045 * width)) > 1) continue;
        // The skin below the eye.
        const int below = int(std::lround(eye_y + 0.06 * width));
        std::copy_n(open.pixel(below, int(std::lround(eye_x))), open.channels(), picture.pixel(y, x));
      }
  }
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

TEST_CASE("a simulated head that turns and sways raises no alarm at its outline, closed eyes do") {
  for (const std::uint64_t seed : {113, 139}) {
    sim::Simulation simulation = moving_head(60);
    simulation.seed = simulation.subject.seed = seed;
    simulation.motion.amplitude_m *= 4.5;
    simulation.motion.rotation_degrees *= 4.5;
    const sim::World world(simulation);
    const core::Image key = tracking_frame(world, 30 * kStep / 2, seed);
    const core::Image subject = subject_mask(key);
    const auto agreement = [&](const core::Image& frame) {
      const FlowField there = compute_flow(key, frame), back = compute_flow(frame, key);
      return agreement_of(key, frame, there, flow_confidence(there, back), subject);
    };
    std::vector<core::Image> frames;
    std::vector<Agreement> agreements;
    double largest = 0;
    for (const int frame : {0, 8, 19, 41, 52, 59}) {
      frames.push_back(tracking_frame(world, frame * kStep / 2, seed + std::uint64_t(frame)));
      agreements.push_back(agreement(frames.back()));
      largest = std::max(largest, agreements.back().motion_px);
    }
    INFO("seed " << seed << ", farthest " << largest << " px");
    CHECK(largest > 4);
    for (const std::string& objection : objections(agreements, 256)) CHECK(objection.empty());
    const std::size_t blinking = seed % frames.size();
    close_eyes(frames[blinking], subject);
    agreements[blinking] = agreement(frames[blinking]);
    const std::vector<std::string> found = objections(agreements, 256);
    for (std::size_t i = 0; i < found.size(); ++i) {
      INFO("frame " << i << ": " << found[i]);
      CHECK(found[i] == (i == blinking ? "changed in places, as by a blink or an expression" : ""));
    }
  }
}

}  // namespace lightstage::align
