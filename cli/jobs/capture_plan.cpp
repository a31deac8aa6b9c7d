#include "cli/jobs/capture_plan.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "capture/light_schedule.h"
#include "capture/v4l2_cameras.h"
#include "core/disk_space.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/text.h"
#include "db/content_hash.h"
#include "db/object_room.h"

namespace lightstage::cli {

namespace {

// A mirror shows the LEDs themselves, thousands of times brighter than a lit face.
constexpr core::Nanoseconds kMirrorExposure = 10'000;
// White all over is twice as bright as a face.
constexpr core::Nanoseconds kCardExposure = 10 * core::kMillisecond;
constexpr core::Nanoseconds kExposureUnit = core::kMillisecond / 10;

sim::SubjectSpec subject(const CaptureRequest& request) {
  const int chosen = int(request.procedural_seed.has_value()) + int(!request.mesh.empty()) + int(request.mirror_ball) +
                     int(request.grey_ball) + int(request.chessboard) + int(request.white_card);
  if (chosen != 1) {
    throw core::UsageError(
        "a simulated capture needs one subject: --procedural SEED, --mesh FILE, --mirror-ball, "
        "--grey-ball, --chessboard or --white-card");
  }
  sim::SubjectSpec spec;
  spec.seed = request.procedural_seed.value_or(request.seed);
  spec.yaw_degrees = request.yaw_degrees;
  if (!request.mesh.empty()) {
    spec.kind = sim::SubjectKind::kMesh;
    if (!std::filesystem::is_regular_file(request.mesh)) {
      throw core::BadInput(request.mesh.string() + ": no such mesh file");
    }
    spec.mesh_path = std::filesystem::canonical(request.mesh).string();
    spec.mesh_hash = db::hash_file(spec.mesh_path).hex();
  }
  if (request.mirror_ball) spec.kind = sim::SubjectKind::kMirrorBall;
  if (request.grey_ball) spec.kind = sim::SubjectKind::kGreyBall;
  if (request.chessboard) spec.kind = sim::SubjectKind::kChessboard;
  if (request.white_card) spec.kind = sim::SubjectKind::kWhiteCard;
  if (request.mirror_ball || request.grey_ball) spec.size_m = request.ball_radius_mm / 1000;
  spec.position = {request.at[0], request.at[1], request.at[2]};
  return spec;
}

// The same optics on a sensor of another resolution.
void resize(core::CameraModel& camera, int size) {
  const double scale = double(size) / camera.width;
  camera.cx = (camera.cx + 0.5) * scale - 0.5;  // pixel centres are at integers
  camera.cy = (camera.cy + 0.5) * scale - 0.5;
  camera.fx *= scale;
  camera.fy *= scale;
  camera.height = int(std::lround(camera.height * scale));
  camera.width = size;
}

core::Nanoseconds whole_units(core::Nanoseconds exposure) {
  return std::max<core::Nanoseconds>(1, (exposure + kExposureUnit / 2) / kExposureUnit) * kExposureUnit;
}

// A board is held up in one pose after another, all lights on.
capture::Sequence board_sequence(const CaptureRequest& request, std::size_t lights) {
  constexpr core::Nanoseconds kTimeToMove = 2 * core::kSecond;
  core::Nanoseconds exposure = capture::default_full_on_exposure(20 * core::kMillisecond, lights);
  if (!request.exposure_ms.empty()) exposure = core::from_units(request.exposure_ms.front(), core::kMillisecond);
  if (!request.simulate) exposure = whole_units(exposure);
  capture::Sequence sequence;
  sequence.settle = kTimeToMove;
  const auto add = [&](db::StepKind kind) {
    sequence.steps.push_back({.step_index = int(sequence.steps.size()), .kind = kind, .exposure_ns = exposure});
  };
  add(db::StepKind::kDark);
  for (int i = 0; i < request.board_views; ++i) add(db::StepKind::kFullOn);
  return sequence;
}

constexpr int kTrackingEvery = 10;
constexpr int kMostTrackingEvery = 200;

capture::Sequence default_sequence(const CaptureRequest& request, std::size_t lights, int tracking_every) {
  if (request.exposure_ms.size() > 1 && (request.mirror_ball || request.grey_ball || request.chessboard)) {
    throw core::UsageError("--exposure: a pass of a ball or a board takes one exposure; give it once");
  }
  if (request.chessboard) return board_sequence(request, lights);
  capture::OlatOptions olat;
  olat.light_count = lights;
  olat.tracking_every = scan_kind(request) == db::ScanKind::kOlat && !request.white_card ? tracking_every : 0;
  if (request.white_card) olat.exposure = kCardExposure;
  if (request.mirror_ball) {
    // Around the LEDs' images in the mirror, in the full-on frame that its outline is found in, are only the dim
    // surroundings.
    olat.full_on_exposure = 10 * capture::default_full_on_exposure(olat.exposure, lights);
    olat.exposure = kMirrorExposure;
  }
  if (!request.exposure_ms.empty()) {
    std::vector<core::Nanoseconds> exposures;
    for (const double ms : request.exposure_ms) exposures.push_back(core::from_units(ms, core::kMillisecond));
    std::sort(exposures.begin(), exposures.end());
    const auto middle = exposures.begin() + std::ptrdiff_t((exposures.size() - 1) / 2);
    olat.exposure = *middle;
    exposures.erase(middle);
    olat.further_exposures = exposures;
  }
  if (!request.simulate) {
    if (request.exposure_ms.empty()) olat.exposure = whole_units(olat.exposure);
    olat.full_on_exposure =
        whole_units(olat.full_on_exposure.value_or(capture::default_full_on_exposure(olat.exposure, lights)));
  }
  return capture::make_olat_sequence(olat);
}

sim::Simulation plan_simulation(const CaptureRequest& request, capture::Stage stage) {
  sim::Simulation simulation;
  simulation.subject = subject(request);
  simulation.stage = std::move(stage);
  if (request.size > 0) {
    for (capture::StageCamera& camera : simulation.stage.cameras) resize(camera.model, request.size);
  }
  simulation.seed = request.seed;
  simulation.indirect_bounce = request.bounce;
  simulation.faults.drop_exposures = request.drop;
  if (request.no_noise) simulation.sensor.noise = false;
  if (request.no_motion) simulation.motion = {.amplitude_m = 0, .rotation_degrees = 0};
  return simulation;
}

// The simulated devices' is known, real ones' is not before they have been used.
std::vector<capture::Pace> paces(const CaptureProvenance& plan) {
  // Exposures begin 4 standard deviations of the trigger's jitter late.
  if (plan.simulation) return {{.overhead = 4 * plan.simulation->faults.trigger_jitter, .period = kSimulatedPeriod}};
  return capture::possible_paces();
}

std::vector<std::string> exceeded(const CaptureProvenance& plan) {
  return capture::exceeded_limits(plan.sequence, plan.stage.light_positions.size(), plan.stage.limits, paces(plan));
}

void use_sequence(const CaptureRequest& request, capture::Sequence sequence, CaptureProvenance& plan) {
  plan.sequence = std::move(sequence);
  plan.pass_steps = plan.sequence.steps.size();
  if (request.timing) plan.sequence.timing = *request.timing;
  if (request.settle_ms) plan.sequence.settle = core::from_units(*request.settle_ms, core::kMillisecond);
}

// The fewest lights between tracking frames, at least so many, with which the default sequence keeps the limits.
std::optional<int> harmless_tracking(const CaptureRequest& request, int least, CaptureProvenance plan) {
  const std::size_t lights = plan.stage.light_positions.size();
  for (int every = least; every <= kMostTrackingEvery; every += std::max(1, every / 8)) {
    use_sequence(request, default_sequence(request, lights, every), plan);
    if (exceeded(plan).empty()) return every;
  }
  return std::nullopt;
}

}  // namespace

void require_within_limits(CaptureProvenance& plan, bool i_know) {
  plan.exceeded_limits = exceeded(plan);
  if (plan.exceeded_limits.empty()) return;
  const std::string text = core::joined(plan.exceeded_limits, "; ");
  if (!i_know) {
    throw core::UsageError(text +
                           "; take fewer tracking frames (--tracking-every), dim them by `pattern` steps of a sequence "
                           "file, or go more slowly "
                           "(--settle); --i-know takes it as it is, when nobody can be harmed");
  }
  core::warn(text + "; taken all the same (--i-know), except for what the controllers themselves do not do");
}

bool require_rest_within_limits(const db::Store& store, const std::string& name, CaptureProvenance& plan, bool i_know) {
  const db::Scan scan = store.scan(name);
  std::map<int, std::size_t> stored;
  for (const db::Frame& frame : store.frames(scan.id)) ++stored[frame.step_index];
  CaptureProvenance rest = plan;
  std::erase_if(rest.sequence.steps,
                [&](const db::Step& step) { return stored[step.step_index] >= scan.cameras.size(); });
  require_within_limits(rest, i_know);
  for (const std::string& line : rest.exceeded_limits) {
    if (std::find(plan.exceeded_limits.begin(), plan.exceeded_limits.end(), line) == plan.exceeded_limits.end())
      plan.exceeded_limits.push_back(line);
  }
  return !rest.exceeded_limits.empty();
}

db::ScanKind scan_kind(const CaptureRequest& request) {
  if (request.mirror_ball) return db::ScanKind::kMirrorBall;
  if (request.grey_ball) return db::ScanKind::kGreyBall;
  if (request.chessboard) return db::ScanKind::kChessboard;
  return db::ScanKind::kOlat;
}

CaptureProvenance plan_capture(const CaptureRequest& request) {
  if (request.stage_file.empty()) {
    throw core::UsageError("--stage FILE is needed (make one: lightstage stage --out stage.toml)");
  }
  CaptureProvenance provenance;
  provenance.stage = capture::read_stage(request.stage_file);
  if (request.simulate) {
    provenance.simulation = plan_simulation(request, std::move(provenance.stage));
    provenance.stage = provenance.simulation->stage;
  } else {
    if (int(request.mirror_ball) + int(request.grey_ball) + int(request.chessboard) + int(request.white_card) > 1) {
      throw core::UsageError("one thing stands on the stage: --mirror-ball, --grey-ball, --chessboard or --white-card");
    }
    if (!provenance.stage.hardware.complete()) {
      throw core::UsageError(
          request.stage_file.string() +
          " names no LED controllers and camera devices (docs/hardware.md); for a simulated stage add --sim");
    }
  }
  const std::size_t lights = provenance.stage.light_positions.size();
  int every = request.tracking_every.value_or(kTrackingEvery);
  const bool tracks = scan_kind(request) == db::ScanKind::kOlat && !request.white_card && request.sequence_file.empty();
  if (tracks && !request.tracking_every && !request.i_know) {
    use_sequence(request, default_sequence(request, lights, every), provenance);
    every = harmless_tracking(request, every, provenance).value_or(every);
    if (every != kTrackingEvery) {
      core::note("a tracking frame before every " + std::to_string(every) + "th light, not every " +
                 std::to_string(kTrackingEvery) + "th: these would flash too often ([limits] of the stage file)");
    }
  }
  use_sequence(request,
               request.sequence_file.empty() ? default_sequence(request, lights, every)
                                             : capture::read_sequence(request.sequence_file, lights),
               provenance);
  require_within_limits(provenance, request.i_know);
  return provenance;
}

void require_room(const db::Store& store, const std::string& name, const CaptureProvenance& plan) {
  const std::optional<db::Scan> scan = store.find_scan(name);
  std::uintmax_t bytes = 0;
  std::size_t missing = 0;
  for (std::size_t i = 0; i < plan.stage.cameras.size(); ++i) {
    const capture::StageCamera& camera = plan.stage.cameras[i];
    core::ImageSize size{camera.model.height, camera.model.width, 3};
    if (!plan.simulation) size.channels = capture::picture_channels(plan.stage.hardware.cameras[i]);
    const std::size_t stored = scan ? store.frames(scan->id, camera.name).size() : 0;
    const std::size_t frames = plan.sequence.steps.size() - std::min(stored, plan.sequence.steps.size());
    bytes += db::most_bytes(size, frames);
    missing += frames;
  }
  core::require_room(store.folder(), bytes, "capturing '" + name + "' (" + std::to_string(missing) + " frames)");
}

db::Scan begin_scan(db::Store& store, const std::string& name, const CaptureRequest& request,
                    const CaptureProvenance& provenance) {
  db::NewScan scan;
  scan.name = name;
  scan.kind = scan_kind(request);
  scan.stage_key = capture::stage_key(provenance.stage);
  scan.provenance = to_json(provenance);
  for (const capture::StageCamera& camera : provenance.stage.cameras) scan.cameras.push_back(camera.name);
  scan.steps = provenance.sequence.steps;
  return store.scan(store.add_scan(scan));
}

}  // namespace lightstage::cli
