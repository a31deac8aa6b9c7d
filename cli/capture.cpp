#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "capture/hardware_rig.h"
#include "capture/light_check.h"
#include "capture/preview.h"
#include "capture/session.h"
#include "cli/commands.h"
#include "cli/jobs/mask.h"
#include "cli/jobs/provenance.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/progress.h"
#include "db/content_hash.h"
#include "sim/rig.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string name;
  bool simulate = false;
  bool resume = false;
  std::filesystem::path stage_file;
  std::filesystem::path sequence_file;
  std::optional<std::uint64_t> procedural_seed;
  std::filesystem::path mesh;
  bool mirror_ball = false, grey_ball = false, chessboard = false;
  double ball_radius_mm = 60;
  double yaw_degrees = 0;
  int size = 0;
  bool no_noise = false, no_motion = false;
  bool bounce = false;
  std::uint64_t seed = 1;
  int tracking_every = 10;
  std::optional<double> exposure_ms;
  std::vector<int> drop;
  std::optional<capture::Timing> timing;
  std::optional<double> settle_ms;
  bool dry_run = false;
  bool check_lights = false, skip_light_check = false;
  std::filesystem::path preview;
  int preview_every = 10;
  bool tev = false;
  std::string tev_address = "127.0.0.1:14158";
};

db::ScanKind scan_kind(sim::SubjectKind subject) {
  switch (subject) {
    case sim::SubjectKind::kMirrorBall:
      return db::ScanKind::kMirrorBall;
    case sim::SubjectKind::kGreyBall:
      return db::ScanKind::kGreyBall;
    case sim::SubjectKind::kChessboard:
      return db::ScanKind::kChessboard;
    default:
      return db::ScanKind::kOlat;
  }
}

sim::SubjectSpec subject(const Options& options) {
  const int chosen = int(options.procedural_seed.has_value()) + int(!options.mesh.empty()) + int(options.mirror_ball) +
                     int(options.grey_ball) + int(options.chessboard);
  if (chosen != 1) {
    throw core::UsageError(
        "a simulated capture needs one subject: --procedural SEED, --mesh FILE, --mirror-ball, "
        "--grey-ball or --chessboard");
  }
  sim::SubjectSpec spec;
  spec.seed = options.procedural_seed.value_or(options.seed);
  spec.yaw_degrees = options.yaw_degrees;
  if (!options.mesh.empty()) {
    spec.kind = sim::SubjectKind::kMesh;
    if (!std::filesystem::is_regular_file(options.mesh)) {
      throw core::BadInput(options.mesh.string() + ": no such mesh file");
    }
    spec.mesh_path = std::filesystem::canonical(options.mesh).string();
    spec.mesh_hash = db::hash_file(spec.mesh_path).hex();
  }
  if (options.mirror_ball) spec.kind = sim::SubjectKind::kMirrorBall;
  if (options.grey_ball) spec.kind = sim::SubjectKind::kGreyBall;
  if (options.chessboard) spec.kind = sim::SubjectKind::kChessboard;
  if (options.mirror_ball || options.grey_ball) spec.size_m = options.ball_radius_mm / 1000;
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

core::Nanoseconds nanoseconds(double milliseconds) {
  return core::Nanoseconds(std::llround(milliseconds * 1e6));
}

CaptureProvenance plan(const Options& options) {
  if (options.stage_file.empty())
    throw core::UsageError("--stage FILE is needed (make one: lightstage stage --out stage.toml)");
  sim::Simulation simulation;
  simulation.subject = subject(options);
  simulation.stage = capture::read_stage(options.stage_file);
  if (options.size > 0) {
    for (capture::StageCamera& camera : simulation.stage.cameras) resize(camera.model, options.size);
  }
  simulation.seed = options.seed;
  simulation.indirect_bounce = options.bounce;
  simulation.faults.drop_exposures = options.drop;
  if (options.no_noise) simulation.sensor.noise = false;
  if (options.no_motion) simulation.motion = {.amplitude_m = 0, .rotation_degrees = 0};

  CaptureProvenance provenance;
  provenance.stage = simulation.stage;
  const std::size_t lights = simulation.stage.light_positions.size();
  if (options.sequence_file.empty()) {
    capture::OlatOptions olat;
    olat.light_count = lights;
    olat.tracking_every = scan_kind(simulation.subject.kind) == db::ScanKind::kOlat ? options.tracking_every : 0;
    if (options.mirror_ball) {
      // A mirror shows the LEDs themselves, thousands of times brighter than a lit face; and around them, in the full-on frame that its
      // outline is found in, only the dim surroundings.
      olat.full_on_exposure = 10 * capture::default_full_on_exposure(olat.exposure, lights);
      olat.exposure = 10'000;
    }
    if (options.exposure_ms) olat.exposure = nanoseconds(*options.exposure_ms);
    provenance.sequence = capture::make_olat_sequence(olat);
  } else {
    provenance.sequence = capture::read_sequence(options.sequence_file, lights);
  }
  provenance.simulation = std::move(simulation);
  return provenance;
}

db::Scan begin_scan(db::Store& store, const Options& options) {
  const CaptureProvenance provenance = plan(options);
  db::NewScan scan;
  scan.name = options.name;
  scan.kind = scan_kind(provenance.simulation->subject.kind);
  scan.stage_key = capture::stage_key(provenance.stage);
  scan.provenance = to_json(provenance);
  for (const capture::StageCamera& camera : provenance.stage.cameras) scan.cameras.push_back(camera.name);
  scan.steps = provenance.sequence.steps;
  return store.scan(store.add_scan(scan));
}

void capture_scan(const Options& options, Context& context) {
  if (!options.resume && !options.simulate) {
    throw core::UsageError("this version drives simulated stages only: add --sim");
  }
  db::Store store = context.open_store();
  const db::Scan scan = options.resume ? store.scan(options.name) : begin_scan(store, options);
  const CaptureProvenance provenance = capture_provenance(scan);

  const sim::World world(*provenance.simulation);
  core::VirtualClock clock;
  clock.sleep_until(capture::end_of_last_exposure(store, scan));  // a resumed pass goes on where the motion was
  sim::SimulatedRig rig(world, clock);
  const capture::SessionReport report = run_session(store, scan, provenance.sequence, rig.rig());
  if (scan.kind == db::ScanKind::kOlat && !store.newest_product("mask", scan.id)) store_subject_masks(store, scan);

  const std::size_t frames = report.already_stored + report.stored;
  std::string text = "captured '" + scan.name + "': " + std::to_string(frames) + " frames of " +
                     std::to_string(report.steps) + " steps";
  if (report.already_stored > 0) text += ", " + std::to_string(report.already_stored) + " of them stored before";
  text += "; " + std::to_string(report.dropped) + " dropped, " + std::to_string(report.discarded) + " discarded, " +
          std::to_string(report.retaken) + " retaken\n";
  context.result(text, {{"scan", scan.name},
                        {"steps", report.steps},
                        {"frames", frames},
                        {"already_stored", report.already_stored},
                        {"stored", report.stored},
                        {"dropped", report.dropped},
                        {"discarded", report.discarded},
                        {"retaken", report.retaken},
                        {"stage_seconds", double(report.duration) / core::kSecond}});
}

}  // namespace

void add_capture(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("capture", "Run a light sequence and store every frame");
  command->footer(
      "Examples:\n"
      "  lightstage capture --sim --procedural 7 --stage stage.toml --size 256 --name head\n"
      "  lightstage capture --sim --mesh head.ply --stage stage.toml --name scan1 --no-noise --no-motion\n"
      "  lightstage capture --resume --name head        (after an interruption)");
  auto options = std::make_shared<Options>();
  command->add_option("--name", options->name, "Name of the scan")->required();
  command->add_flag("--sim", options->simulate, "Capture on the simulated stage");
  command->add_option("--stage", options->stage_file, "Stage file (see `lightstage stage`)");
  command->add_option("--sequence", options->sequence_file, "Sequence file; default: every light once");
  command->add_option("--procedural", options->procedural_seed, "Subject: a procedural head, by seed");
  command->add_option("--mesh", options->mesh, "Subject: a mesh file (PLY, OBJ, glTF)");
  command->add_flag("--mirror-ball", options->mirror_ball, "Subject: a mirror ball, for `calibrate`");
  command->add_flag("--grey-ball", options->grey_ball, "Subject: a grey ball, for `calibrate --grey`");
  command->add_flag("--chessboard", options->chessboard, "Subject: a chessboard");
  command->add_option("--ball-radius", options->ball_radius_mm, "Radius of the ball, millimetres")
      ->capture_default_str()
      ->check(number_between(5.0, 500.0));
  command->add_option("--yaw", options->yaw_degrees, "Turn the subject, degrees")->capture_default_str();
  command->add_option("--size", options->size, "Picture width and height, pixels [the stage file's]")
      ->check(CLI::Range(16, 16384));
  command->add_option("--tracking-every", options->tracking_every, "A tracking frame before every n-th light; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(0, 100000));
  command
      ->add_option("--exposure", options->exposure_ms,
                   "Exposure of the single lights, milliseconds [20; mirror ball 0.01]")
      ->check(number_between(0.0001, 10000.0));
  command->add_flag("--no-noise", options->no_noise, "A sensor without noise and quantisation");
  command->add_flag("--no-motion", options->no_motion, "A subject that stands still");
  command->add_flag("--bounce", options->bounce, "One bounce of indirect light");
  command->add_option("--seed", options->seed, "Seed of noise, motion and faults")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  command->add_option("--drop", options->drop, "Lose the frame of the n-th exposure (from 0), to see it retaken");
  command->add_flag("--resume", options->resume, "Go on with an interrupted capture of that name");
  command->callback([options, &context] { capture_scan(*options, context); });
}

}  // namespace lightstage::cli
