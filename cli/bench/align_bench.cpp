#include "cli/bench/align_bench.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "capture/sequence.h"
#include "capture/stage.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "core/stopwatch.h"
#include "model/evaluation.h"
#include "model/methods.h"
#include "model/metrics.h"
#include "sim/sensor.h"

namespace lightstage::cli {

namespace {

constexpr core::Nanoseconds kExposure = 20 * core::kMillisecond;

const capture::StageCamera& camera_of(const sim::World& world) {
  return world.simulation().stage.cameras.front();
}

sim::Simulation simulation_of(const MovingPassOptions& options, double times) {
  capture::LayoutOptions layout;
  layout.lights = options.lights;
  layout.camera_pixels = options.pixels;
  sim::Simulation simulation;
  simulation.stage = capture::make_stage("simulated", layout);
  simulation.subject.seed = options.seed;
  simulation.seed = options.seed;
  simulation.sensor.vignetting = 0;  // the truth is the lens's alone
  simulation.motion.amplitude_m *= times;
  simulation.motion.rotation_degrees *= times;
  return simulation;
}

bool on_subject(const core::Image& coverage, const align::FlowField& flow, int y, int x) {
  return coverage(y, x) > 0.5F && std::isfinite(flow(y, x, 0));
}

double median_length(const align::FlowField& flow, const core::Image& coverage) {
  std::vector<float> lengths;
  for (int y = 0; y < flow.height(); ++y)
    for (int x = 0; x < flow.width(); ++x)
      if (on_subject(coverage, flow, y, x)) lengths.push_back(std::hypot(flow(y, x, 0), flow(y, x, 1)));
  return lengths.empty() ? 0 : core::quantile(lengths, 0.5);
}

std::vector<int> tracking_places(const MovingPass& pass, int every) {
  // The key frame is one of them whatever the period is.
  std::vector<int> places;
  for (int frame = pass.key() % every; frame < pass.frame_count(); frame += every) places.push_back(frame);
  if (places.front() != 0) places.insert(places.begin(), 0);
  if (places.back() != pass.frame_count() - 1) places.push_back(pass.frame_count() - 1);
  return places;
}

double psnr_of(const core::OlatScan& scan, const std::vector<core::Direction>& directions,
               const std::vector<core::Image>& truth, double exposure) {
  model::MethodOptions options;
  options.domain = model::Domain::kLinear;
  const auto blending = model::make_interpolator("linear", scan, options);
  double sum = 0;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    sum += model::mean_squared_error(model::judged(blending->render(directions[i]), exposure, false),
                                     model::judged(truth[i], exposure, false), scan.mask());
  }
  return -10 * std::log10(sum / double(directions.size()));
}

}  // namespace

MovingPass::MovingPass(const MovingPassOptions& options) : options_(options) {
  const auto farthest = [&] {
    double largest = 0;
    for (int frame = 0; frame < frame_count(); frame += 5) {
      largest = std::max(largest, median_length(true_flow(frame), coverage_));
    }
    return largest;
  };
  const auto move = [&](double times) {
    world_ = std::make_unique<sim::World>(simulation_of(options_, times));
    coverage_ = world_->coverage(camera_of(*world_).model, time_of(key()));
    motion_px_ = farthest();
  };
  move(options.motion_px > 0 ? 1 : 0);
  if (options.motion_px > 0) move(options.motion_px / motion_px_);
}

core::Nanoseconds MovingPass::time_of(int frame) {
  return frame * 25 * core::kMillisecond;
}

core::Image MovingPass::tracking_frame(int frame) const {
  std::vector<capture::LightLevel> all;
  for (std::size_t i = 0; i < options_.lights; ++i) all.push_back({int(i)});
  const capture::StageCamera& camera = camera_of(*world_);
  return sim::sense(world_->render(camera.model, all, time_of(frame)), world_->simulation().sensor, camera.responsivity,
                    capture::default_full_on_exposure(kExposure, options_.lights),
                    options_.seed * 100003 + std::uint64_t(frame));
}

core::Image MovingPass::light_frame(int frame) const {
  const capture::LightLevel light{frame};
  const capture::StageCamera& camera = camera_of(*world_);
  return sim::sense(world_->render(camera.model, std::span(&light, 1), time_of(frame)), world_->simulation().sensor,
                    camera.responsivity, kExposure, options_.seed * 200003 + std::uint64_t(frame));
}

align::FlowField MovingPass::true_flow(int frame) const {
  return world_->true_flow(camera_of(*world_).model, time_of(key()), time_of(frame));
}

core::OlatScan MovingPass::scan(std::vector<core::Image> images) const {
  auto shared = std::make_shared<const std::vector<core::Image>>(std::move(images));
  const core::ImageSize size{shared->front().height(), shared->front().width(), 3};
  return core::OlatScan("simulated", capture::nominal_lights(world_->simulation().stage), size, coverage_,
                        [shared](std::size_t light) { return core::to_rgb((*shared)[light]); });
}

std::vector<core::Image> MovingPass::truth(const std::vector<core::Direction>& directions) const {
  return world_->render_directions(camera_of(*world_).model, directions, time_of(key()));
}

std::vector<core::Direction> MovingPass::between_lights(std::size_t count) const {
  std::vector<core::Direction> lights, result;
  for (const core::Light& light : capture::nominal_lights(world_->simulation().stage))
    lights.push_back(light.direction);
  count = std::min(count, lights.size());
  for (std::size_t i = 0; i < count; ++i) {
    const core::Direction& light = lights[i * lights.size() / count];
    const core::Direction& neighbour = lights[core::nearest_indices(lights, light, 2).back()];
    result.push_back(core::Direction::from_vector(
        {light.x() + neighbour.x(), light.y() + neighbour.y(), light.z() + neighbour.z()}));
  }
  return result;
}

AlignRow track_pass(const MovingPass& pass, const AlignKnobs& knobs, align::MotionTrack* motion) {
  const std::vector<int> places = tracking_places(pass, knobs.every);
  const core::Image key = pass.tracking_frame(pass.key());
  std::vector<core::Image> frames(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    core::throw_if_interrupted();
    frames[i] = pass.tracking_frame(places[i]);
  }
  std::vector<align::FlowField> flows(places.size(), align::FlowField(key.height(), key.width(), 2));
  std::vector<core::Image> confidences(places.size());
  const core::Stopwatch watch;
  core::parallel_for(places.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      if (places[i] == pass.key()) continue;
      flows[i] = align::compute_flow(key, frames[i], knobs.flow, knobs.shrink);
      confidences[i] = align::flow_confidence(flows[i], align::compute_flow(frames[i], key, knobs.flow, knobs.shrink));
    }
  });
  AlignRow row;
  row.knobs = knobs;
  row.seconds = watch.seconds();
  std::size_t subject = 0, believed = 0;
  for (const core::Image& confidence : confidences) {
    for (std::size_t i = 0; i < confidence.values().size(); ++i) {
      if (pass.coverage().values()[i] <= 0.5F) continue;
      ++subject;
      believed += confidence.values()[i] > 0;
    }
  }
  row.believed = subject == 0 ? 1 : double(believed) / double(subject);

  align::MotionTrack track(knobs.between);
  for (std::size_t i = 0; i < places.size(); ++i) track.add(MovingPass::time_of(places[i]), std::move(flows[i]));
  std::vector<float> errors;
  constexpr int kEveryJudged = 3;
  for (int frame = 1; frame < pass.frame_count(); frame += kEveryJudged) {
    if (std::binary_search(places.begin(), places.end(), frame)) continue;
    const align::FlowField truth = pass.true_flow(frame), found = track.at(MovingPass::time_of(frame));
    for (int y = 0; y < truth.height(); ++y)
      for (int x = 0; x < truth.width(); ++x)
        if (on_subject(pass.coverage(), truth, y, x))
          errors.push_back(std::hypot(truth(y, x, 0) - found(y, x, 0), truth(y, x, 1) - found(y, x, 1)));
  }
  row.median_epe_px = core::quantile(errors, 0.5);
  row.p95_epe_px = core::quantile(errors, 0.95);
  if (motion != nullptr) *motion = std::move(track);
  return row;
}

BlendingGain blending_gain(const MovingPass& pass, const align::MotionTrack& motion, std::size_t directions) {
  std::vector<core::Image> unaligned, aligned;
  core::Progress progress("light frames", std::size_t(pass.frame_count()));
  for (int frame = 0; frame < pass.frame_count(); ++frame) {
    core::throw_if_interrupted();
    unaligned.push_back(pass.light_frame(frame));
    aligned.push_back(align::warp(unaligned.back(), motion.at(MovingPass::time_of(frame))));
    progress.advance();
  }
  const core::OlatScan as_taken = pass.scan(std::move(unaligned));
  std::vector<core::Direction> lights;
  for (std::size_t i = 0; i < as_taken.light_count(); ++i) lights.push_back(as_taken.light(i).direction);
  const core::OlatScan still = pass.scan(pass.truth(lights));
  const std::vector<core::Direction> asked = pass.between_lights(directions);
  const std::vector<core::Image> truth = pass.truth(asked);
  const double exposure = still.exposure();
  return {.unaligned_db = psnr_of(as_taken, asked, truth, exposure),
          .aligned_db = psnr_of(pass.scan(std::move(aligned)), asked, truth, exposure),
          .still_db = psnr_of(still, asked, truth, exposure)};
}

StillRow still_subject(const MovingPassOptions& options, const AlignKnobs& knobs) {
  MovingPassOptions still = options;
  still.motion_px = 0;
  const MovingPass pass(still);
  const core::Image key = pass.tracking_frame(pass.key());
  std::vector<float> lengths;
  for (int frame = 0; frame < pass.frame_count(); frame += pass.frame_count() / 4) {
    const align::FlowField flow = align::compute_flow(key, pass.tracking_frame(frame + 1), knobs.flow, knobs.shrink);
    for (int y = 0; y < flow.height(); ++y)
      for (int x = 0; x < flow.width(); ++x)
        if (pass.coverage()(y, x) > 0.5F) lengths.push_back(std::hypot(flow(y, x, 0), flow(y, x, 1)));
  }
  return {.median_px = core::quantile(lengths, 0.5), .p95_px = core::quantile(lengths, 0.95)};
}

}  // namespace lightstage::cli
