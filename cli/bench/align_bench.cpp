#include "cli/bench/align_bench.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <random>
#include <utility>

#include "align/agreement.h"
#include "align/registration.h"
#include "align/subject_mask.h"
#include "capture/sequence.h"
#include "capture/stage.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "core/stopwatch.h"
#include "db/importers.h"
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
  simulation.motion.amplitude_m *= options.kind == MotionKind::kTurn ? 0 : times;
  simulation.motion.rotation_degrees *= options.kind == MotionKind::kShift ? 0 : times;
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

struct SquaredError {
  double sum = 0;
  std::size_t count = 0;
  void add(float a, float b) {
    sum += double(a - b) * double(a - b);
    ++count;
  }
  double root_mean() const { return count == 0 ? 0 : std::sqrt(sum / double(count)); }
};

// Both eyes of a head that looks at the camera, by where it begins and ends.
void close_eyes(core::Image& picture, const core::Image& subject) {
  constexpr double kAcross = 0.16, kDown = 0.46;             // of the head's width from its middle, of its height
  constexpr double kHalfWidth = 0.077, kHalfHeight = 0.045;  // of its width
  constexpr double kRing = 1.5;                              // times as large, for the colour around
  int left = subject.width(), right = -1, top = subject.height(), bottom = -1;
  for (int y = 0; y < subject.height(); ++y) {
    for (int x = 0; x < subject.width(); ++x) {
      if (subject(y, x) <= 0.5F) continue;
      left = std::min(left, x);
      right = std::max(right, x);
      top = std::min(top, y);
      bottom = std::max(bottom, y);
    }
  }
  const double width = right - left + 1;
  for (const double side : {-1.0, 1.0}) {
    const double eye_x = 0.5 * (left + right) + side * kAcross * width, eye_y = top + kDown * (bottom - top + 1);
    const auto distance = [&](int x, int y) {
      return std::hypot((x - eye_x) / (kHalfWidth * width), (y - eye_y) / (kHalfHeight * width));
    };
    for (int c = 0; c < picture.channels(); ++c) {
      double sum = 0;
      int count = 0;
      for (int y = 0; y < picture.height(); ++y) {
        for (int x = 0; x < picture.width(); ++x) {
          if (distance(x, y) <= 1 || distance(x, y) > kRing) continue;
          sum += double(picture(y, x, c));
          ++count;
        }
      }
      if (count == 0) continue;
      for (int y = 0; y < picture.height(); ++y)
        for (int x = 0; x < picture.width(); ++x)
          if (distance(x, y) <= 1) picture(y, x, c) = float(sum / count);
    }
  }
}

// As bright as each other, so that each counts in the mean, and dark enough to be seen.
core::Image mean_of(const std::vector<core::Image>& pictures) {
  constexpr double kBrightness = 0.3;
  std::vector<core::ImageView> views;
  std::vector<double> weights;
  for (const core::Image& picture : pictures) {
    views.push_back(picture);
    const double level = std::accumulate(picture.values().begin(), picture.values().end(), 0.0);
    weights.push_back(level > 0 ? kBrightness * double(picture.values().size()) / level / double(pictures.size()) : 0);
  }
  return core::weighted_sum(views, weights);
}

// Mean squared gradient away from the border.
double sharpness(const core::Image& picture) {
  const int border = std::max(picture.width(), picture.height()) / 16;
  double sum = 0;
  for (int y = border; y < picture.height() - border; ++y)
    for (int x = border; x < picture.width() - border; ++x) {
      const double dx = double(picture(y, x + 1)) - double(picture(y, x - 1));
      const double dy = double(picture(y + 1, x)) - double(picture(y - 1, x));
      sum += dx * dx + dy * dy;
    }
  return sum;
}

// Of the subject what some frame does not show, so that `align` masks it.
double masked_share(const MovingPass& pass, const align::MotionTrack& motion) {
  std::vector<bool> masked(pass.subject().values().size());
  for (int frame = 0; frame < pass.frame_count(); ++frame) {
    core::Image confidence = motion.confidence_at(MovingPass::time_of(frame));
    align::clear_outside(confidence, motion.at(MovingPass::time_of(frame)));
    for (std::size_t p = 0; p < masked.size(); ++p) {
      if (pass.subject().values()[p] > 0.5F && confidence.values()[p] <= 0) masked[p] = true;
    }
  }
  std::size_t subject = 0;
  for (const float inside : pass.subject().values()) subject += inside > 0.5F;
  return double(std::count(masked.begin(), masked.end(), true)) / double(std::max<std::size_t>(1, subject));
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
    true_flows_.clear();
    tracking_frames_.clear();
    coverage_ = world_->coverage(camera_of(*world_).model, time_of(key()));
    motion_px_ = farthest();
  };
  move(options.motion_px > 0 ? 1 : 0);
  if (options.motion_px > 0) move(options.motion_px / motion_px_);
  subject_ = align::subject_mask(tracking_frame(key()));
}

core::Nanoseconds MovingPass::time_of(int frame) {
  return frame * 25 * core::kMillisecond;
}

const core::Image& MovingPass::tracking_frame(int frame) const {
  core::Image& picture = tracking_frames_[frame];
  if (!picture.empty()) return picture;
  std::vector<capture::LightLevel> all;
  for (std::size_t i = 0; i < options_.lights; ++i) all.push_back({int(i)});
  const capture::StageCamera& camera = camera_of(*world_);
  picture = sim::sense(world_->render(camera.model, all, time_of(frame)), world_->simulation().sensor,
                       camera.responsivity, capture::default_full_on_exposure(kExposure, options_.lights),
                       options_.seed * 100003 + std::uint64_t(frame));
  return picture;
}

core::Image MovingPass::light_frame(int frame) const {
  const capture::LightLevel light{frame};
  const capture::StageCamera& camera = camera_of(*world_);
  return sim::sense(world_->render(camera.model, std::span(&light, 1), time_of(frame)), world_->simulation().sensor,
                    camera.responsivity, kExposure, options_.seed * 200003 + std::uint64_t(frame));
}

const align::FlowField& MovingPass::true_flow(int frame) const {
  align::FlowField& flow = true_flows_[frame];
  if (flow.empty()) flow = world_->true_flow(camera_of(*world_).model, time_of(key()), time_of(frame));
  return flow;
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
  const core::Image& key = pass.tracking_frame(pass.key());
  std::vector<const core::Image*> frames;
  for (const int place : places) {
    core::throw_if_interrupted();
    frames.push_back(&pass.tracking_frame(place));
  }
  std::vector<align::FlowField> flows(places.size(), align::FlowField(key.height(), key.width(), 2));
  std::vector<core::Image> confidences(places.size());
  const core::Stopwatch watch;
  core::parallel_for(places.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      if (places[i] == pass.key()) continue;
      flows[i] = align::compute_flow(key, *frames[i], knobs.flow, knobs.shrink);
      if (align::stands_still(flows[i], pass.subject())) {
        flows[i] = align::FlowField(key.height(), key.width(), 2);
        continue;
      }
      confidences[i] = align::flow_confidence(flows[i], align::compute_flow(*frames[i], key, knobs.flow, knobs.shrink));
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
  for (std::size_t i = 0; i < places.size(); ++i) {
    track.add(MovingPass::time_of(places[i]), std::move(flows[i]), std::move(confidences[i]));
  }
  std::vector<float> errors;
  constexpr int kEveryJudged = 3;
  for (int frame = 1; frame < pass.frame_count(); frame += kEveryJudged) {
    if (std::binary_search(places.begin(), places.end(), frame)) continue;
    const align::FlowField& truth = pass.true_flow(frame);
    const align::FlowField found = track.at(MovingPass::time_of(frame));
    for (int y = 0; y < truth.height(); ++y)
      for (int x = 0; x < truth.width(); ++x)
        if (on_subject(pass.coverage(), truth, y, x))
          errors.push_back(std::hypot(truth(y, x, 0) - found(y, x, 0), truth(y, x, 1) - found(y, x, 1)));
  }
  row.median_epe_px = core::quantile(errors, 0.5);
  row.p95_epe_px = core::quantile(errors, 0.95);
  row.masked = masked_share(pass, track);
  if (motion != nullptr) *motion = std::move(track);
  return row;
}

BlendingGain blending_gain(const MovingPass& pass, const align::MotionTrack& motion, std::size_t directions) {
  std::vector<core::Image> unaligned, aligned, confidences;
  core::Progress progress("light frames", std::size_t(pass.frame_count()));
  for (int frame = 0; frame < pass.frame_count(); ++frame) {
    core::throw_if_interrupted();
    const align::FlowField flow = motion.at(MovingPass::time_of(frame));
    unaligned.push_back(pass.light_frame(frame));
    aligned.push_back(align::warp(unaligned.back(), flow));
    confidences.push_back(motion.confidence_at(MovingPass::time_of(frame)));
    align::clear_outside(confidences.back(), flow);
    progress.advance();
  }
  const core::OlatScan as_taken = pass.scan(std::move(unaligned));
  const std::vector<core::Direction>& lights = as_taken.directions();
  const std::vector<core::Image> still_images = pass.truth(lights);
  const core::OlatScan still = pass.scan(still_images);
  const double exposure = still.exposure();
  BlendingGain gain;
  SquaredError where_hidden, where_shown;
  std::size_t subject = 0;
  for (const float inside : pass.subject().values()) subject += inside > 0.5F;
  for (std::size_t i = 0; i < aligned.size(); ++i) {
    const core::Image truth = model::judged(still_images[i], exposure, false);
    const core::Image found = model::judged(aligned[i], exposure, false);
    const std::size_t channels = std::size_t(truth.channels());
    for (std::size_t p = 0; p < pass.subject().values().size(); ++p) {
      if (pass.subject().values()[p] <= 0.5F) continue;
      const bool hidden = confidences[i].values()[p] <= 0;
      if (hidden) gain.hidden += 1 / double(subject * aligned.size());
      for (std::size_t k = p * channels; k < (p + 1) * channels; ++k) {
        (hidden ? where_hidden : where_shown).add(truth.values()[k], found.values()[k]);
      }
    }
  }
  gain.error_hidden = where_hidden.root_mean();
  gain.error_shown = where_shown.root_mean();
  const std::vector<core::Direction> asked = pass.between_lights(directions);
  const std::vector<core::Image> truth = pass.truth(asked);
  gain.unaligned_db = psnr_of(as_taken, asked, truth, exposure);
  gain.aligned_db = psnr_of(pass.scan(std::move(aligned)), asked, truth, exposure);
  gain.still_db = psnr_of(still, asked, truth, exposure);
  return gain;
}

FacesRow register_faces(const std::filesystem::path& yale_folder) {
  const db::PictureSet set = db::read_yale_set(yale_folder);
  FacesRow row;
  row.name = yale_folder.filename().string();
  std::vector<core::Image> pictures;
  std::vector<core::Direction> lights;
  for (const db::PictureEntry& entry : set.pictures) {
    // Light from behind the face shows nothing to go by.
    if (entry.direction.z() < 0.1) continue;
    pictures.push_back(core::to_luminance(core::read_image(entry.path, {.encoding = set.encoding})));
    lights.push_back(entry.direction);
  }
  row.pictures = pictures.size();
  const auto found = align::register_pictures([&](std::size_t i) { return pictures[i]; }, lights);

  // Shifts of up to 2 pixels on top of what is there: how far the answer changes is known.
  std::vector<core::Image> shifted;
  std::vector<align::RigidMotion> shifts;
  align::RigidMotion mean;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const double angle = 2.4 * double(i), length = 2 * std::fmod(0.618034 * double(i), 1.0);
    shifts.push_back({length * std::cos(angle), length * std::sin(angle), 0});
    mean.dx += shifts.back().dx / double(pictures.size());
    mean.dy += shifts.back().dy / double(pictures.size());
    // shifted(p + shift) = picture(p)
    shifted.push_back(align::warp(pictures[i], align::RigidMotion{-shifts[i].dx, -shifts[i].dy, 0}.flow(
                                                   pictures[i].height(), pictures[i].width())));
  }
  const auto again = align::register_pictures([&](std::size_t i) { return shifted[i]; }, lights);

  std::vector<float> motions, before, after, errors;
  std::vector<core::Image> kept, aligned;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    row.objected += !found[i].objection.empty();
    if (!found[i].objection.empty() || !again[i].objection.empty()) continue;
    motions.push_back(float(std::hypot(found[i].motion.dx, found[i].motion.dy)));
    before.push_back(float(found[i].residual_before_px));
    after.push_back(float(found[i].residual_after_px));
    errors.push_back(float(std::hypot(again[i].motion.dx - found[i].motion.dx - shifts[i].dx + mean.dx,
                                      again[i].motion.dy - found[i].motion.dy - shifts[i].dy + mean.dy)));
    kept.push_back(pictures[i]);
    aligned.push_back(align::warp(pictures[i], found[i].motion.flow(pictures[i].height(), pictures[i].width())));
  }
  if (kept.empty()) return row;
  row.median_motion_px = core::quantile(motions, 0.5);
  row.residual_before_px = core::quantile(before, 0.5);
  row.residual_after_px = core::quantile(after, 0.5);
  row.injected_median_px = core::quantile(errors, 0.5);
  row.injected_p95_px = core::quantile(errors, 0.95);
  row.mean_before = mean_of(kept);
  row.mean_after = mean_of(aligned);
  row.sharpness_gain = sharpness(row.mean_after) / sharpness(row.mean_before);
  return row;
}

FacesRow register_simulated(std::uint64_t seed, double& seconds) {
  constexpr std::size_t kLights = 80;
  constexpr int kPixels = 1024;
  constexpr double kFarthest = 3, kMostTurned = 0.003;
  const sim::World world(simulation_of({.lights = kLights, .pixels = kPixels, .motion_px = 0, .seed = seed}, 0));
  const capture::StageCamera& camera = camera_of(world);
  std::vector<core::Direction> lights;
  for (const core::Light& light : capture::nominal_lights(world.simulation().stage))
    if (light.direction.z() > 0.1) lights.push_back(light.direction);
  std::vector<core::Image> pictures = world.render_directions(camera.model, lights, 0);
  std::vector<align::RigidMotion> motions;
  align::RigidMotion mean;
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const align::RigidMotion motion{kFarthest * uniform(random), kFarthest * uniform(random),
                                    kMostTurned * uniform(random)};
    mean.dx += motion.dx / double(pictures.size());
    mean.dy += motion.dy / double(pictures.size());
    motions.push_back(motion);
    // moved(p + motion) = picture(p): the inverse turns back, and shifts by what was turned back.
    const double c = std::cos(motion.radians), s = std::sin(motion.radians);
    const align::RigidMotion back{-c * motion.dx - s * motion.dy, s * motion.dx - c * motion.dy, -motion.radians};
    core::Image moved = align::warp(pictures[i], back.flow(kPixels, kPixels));
    for (float& value : moved.values()) value = std::max(value, 0.0F);
    pictures[i] = sim::sense(moved, world.simulation().sensor, camera.responsivity, kExposure, seed * 300007 + i);
  }
  const core::Stopwatch watch;
  const auto found = align::register_pictures([&](std::size_t i) { return pictures[i]; }, lights);
  seconds = watch.seconds();
  FacesRow row;
  row.name = "simulated head";
  row.pictures = pictures.size();
  std::vector<float> lengths, before, after, errors;
  for (std::size_t i = 0; i < found.size(); ++i) {
    row.objected += !found[i].objection.empty();
    if (!found[i].objection.empty()) continue;
    lengths.push_back(float(std::hypot(found[i].motion.dx, found[i].motion.dy)));
    before.push_back(float(found[i].residual_before_px));
    after.push_back(float(found[i].residual_after_px));
    errors.push_back(
        float(std::hypot(found[i].motion.dx - motions[i].dx + mean.dx, found[i].motion.dy - motions[i].dy + mean.dy)));
  }
  if (errors.empty()) return row;
  row.median_motion_px = core::quantile(lengths, 0.5);
  row.residual_before_px = core::quantile(before, 0.5);
  row.residual_after_px = core::quantile(after, 0.5);
  row.injected_median_px = core::quantile(errors, 0.5);
  row.injected_p95_px = core::quantile(errors, 0.95);
  return row;
}

BlinkRow blinks(const MovingPassOptions& options, const AlignKnobs& knobs, std::size_t heads) {
  constexpr std::size_t kLights = 60;
  BlinkRow row;
  core::Progress progress("blinks", heads);
  for (std::size_t head = 0; head < heads; ++head) {
    core::throw_if_interrupted();
    MovingPassOptions changed = options;
    changed.lights = kLights;
    changed.seed = options.seed + head;
    const MovingPass pass(changed);
    const core::Image& key = pass.tracking_frame(pass.key());
    std::vector<core::Image> frames;
    for (const int place : tracking_places(pass, knobs.every))
      if (place != pass.key()) frames.push_back(pass.tracking_frame(place));
    const auto agreement = [&](const core::Image& frame) {
      const align::FlowField there = align::compute_flow(key, frame, knobs.flow, knobs.shrink);
      const align::FlowField back = align::compute_flow(frame, key, knobs.flow, knobs.shrink);
      return align::agreement_of(key, frame, there, align::flow_confidence(there, back), pass.subject());
    };
    std::vector<align::Agreement> agreements(frames.size());
    core::parallel_for(frames.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) agreements[i] = agreement(frames[i]);
    });
    const auto count_objections = [&](std::size_t blinking, std::size_t& found, std::size_t& accused) {
      const std::vector<std::string> objections = align::objections(agreements, options.pixels);
      for (std::size_t i = 0; i < objections.size(); ++i) {
        (i == blinking ? found : accused) += !objections[i].empty();
      }
    };
    std::size_t none = 0;
    row.sound_frames += frames.size();
    count_objections(frames.size(), none, row.false_alarms);
    const std::size_t blinking = head % frames.size();
    close_eyes(frames[blinking], pass.subject());
    agreements[blinking] = agreement(frames[blinking]);
    ++row.blinks;
    count_objections(blinking, row.found, row.accused);
    progress.advance();
  }
  return row;
}

StillRow still_subject(const MovingPassOptions& options, const AlignKnobs& knobs) {
  MovingPassOptions still = options;
  still.motion_px = 0;
  const MovingPass pass(still);
  const core::Image& key = pass.tracking_frame(pass.key());
  std::vector<float> lengths, raw;
  for (int frame = 0; frame < pass.frame_count(); frame += pass.frame_count() / 4) {
    align::FlowField flow = align::compute_flow(key, pass.tracking_frame(frame + 1), knobs.flow, knobs.shrink);
    for (int y = 0; y < flow.height(); ++y)
      for (int x = 0; x < flow.width(); ++x)
        if (pass.coverage()(y, x) > 0.5F) raw.push_back(std::hypot(flow(y, x, 0), flow(y, x, 1)));
    if (align::stands_still(flow, pass.subject())) flow = align::FlowField(flow.height(), flow.width(), 2);
    for (int y = 0; y < flow.height(); ++y)
      for (int x = 0; x < flow.width(); ++x)
        if (pass.coverage()(y, x) > 0.5F) lengths.push_back(std::hypot(flow(y, x, 0), flow(y, x, 1)));
  }
  return {.median_px = core::quantile(lengths, 0.5),
          .p95_px = core::quantile(lengths, 0.95),
          .raw_p95_px = core::quantile(raw, 0.95)};
}

}  // namespace lightstage::cli
