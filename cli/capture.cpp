#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "capture/hardware_rig.h"
#include "capture/light_check.h"
#include "capture/preview.h"
#include "capture/session.h"
#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/capture_plan.h"
#include "cli/jobs/mask.h"
#include "cli/jobs/retake.h"
#include "cli/options.h"
#include "cli/seed_option.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/text.h"
#include "db/scan_lock.h"
#include "sim/rig.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  std::string name;
  CaptureRequest request;
  bool resume = false, retake = false;
  bool goes_on() const { return resume || retake; }  // with a scan that exists
  bool dry_run = false;
  std::optional<bool> light_check;
  std::filesystem::path preview;
  int preview_every = 10;
  std::string tev;
};

// Steps of a dry run: enough for rates and rare troubles to show.
constexpr std::size_t kDryRunSteps = 60;

constexpr sim::DeviceTimes kSimulatedTimes{.shortest_period = kSimulatedPeriod};

// The devices of a pass, real or simulated, with the clock that they live by.
class Devices {
 public:
  // `begin`: when a simulated pass goes on; `i_know`: that it exceeds the limits.
  Devices(const CaptureProvenance& provenance, core::Nanoseconds begin, bool i_know) {
    if (provenance.simulation) {
      virtual_clock_.sleep_until(begin);
      world_.emplace(*provenance.simulation);
      // --i-know stands for the switch at the controller that lets lights flash; what protects the LEDs has none.
      sim::ControllerLimits limits{.heat = provenance.stage.limits};
      if (!i_know) limits.flashing = provenance.stage.limits;
      simulated_.emplace(*world_, virtual_clock_, kSimulatedTimes, limits);
    } else {
      hardware_.emplace(provenance.stage, system_clock_,
                        capture::HardwareOptions{.program = std::filesystem::read_symlink("/proc/self/exe")});
    }
  }
  capture::Rig rig() { return simulated_ ? simulated_->rig() : hardware_->rig(); }

 private:
  core::VirtualClock virtual_clock_;
  core::SystemClock system_clock_;
  std::optional<sim::World> world_;
  std::optional<sim::SimulatedRig> simulated_;
  std::optional<capture::HardwareRig> hardware_;
};

// Lights in order, as many as a dry run takes; tracking and dark frames between them stay.
capture::Sequence beginning(capture::Sequence sequence) {
  if (sequence.steps.size() > kDryRunSteps) sequence.steps.resize(kDryRunSteps);
  return sequence;
}

void dry_run(const Options& options, Context& context) {
  const CaptureProvenance provenance = plan_capture(options.request);
  Devices devices(provenance, 0, !provenance.exceeded_limits.empty());
  capture::Sequence sequence = beginning(provenance.sequence);
  std::vector<std::vector<std::string>> rows{
      {"timing", "steps/s", "preparation s", "frames", "retaken", "dropped", "discarded", "safe at this rate"}};
  ordered_json modes = ordered_json::array();
  std::string remarks;
  const auto remark = [&](const std::string& name, const std::string& problem) {
    remarks += name + ": " + problem + "\n";
    modes.push_back({{"timing", name}, {"problem", problem}});
  };
  for (const capture::Timing timing : capture::kTimings) {
    if (options.request.timing && *options.request.timing != timing) continue;
    sequence.timing = timing;
    const std::string name(to_string(timing));
    try {
      CaptureProvenance mode = provenance;
      mode.sequence = sequence;
      require_within_limits(mode, options.request.i_know);
      const capture::SessionReport report = capture::dry_run(sequence, devices.rig());
      const double preparation_s = double(report.preparation) / core::kSecond;
      const double steps_per_s = double(report.steps) * core::kSecond /
                                 double(std::max<core::Nanoseconds>(1, report.duration - report.preparation));
      // A rate at which frames had to be taken again is one at which they are lost.
      const bool safe = report.retaken == 0;
      rows.push_back({name, fixed(steps_per_s, 1), fixed(preparation_s, 2), std::to_string(report.stored),
                      std::to_string(report.retaken), std::to_string(report.dropped), std::to_string(report.discarded),
                      safe ? "yes" : "no"});
      modes.push_back({{"timing", name},
                       {"steps_per_s", steps_per_s},
                       {"preparation_s", preparation_s},
                       {"frames", report.stored},
                       {"retaken", report.retaken},
                       {"dropped", report.dropped},
                       {"discarded", report.discarded},
                       {"safe", safe}});
    } catch (const core::UsageError& error) {  // the rig cannot do this mode, or must not
      remark(name, error.what());
    } catch (const core::DeviceError& error) {
      remark(name, error.what());
    }
  }
  if (rows.size() == 1) {
    remarks.erase(remarks.find_last_not_of('\n') + 1);
    std::replace(remarks.begin(), remarks.end(), '\n', ';');
    throw core::DeviceError("no timing mode works: " + remarks);
  }
  context.result(table(rows) + remarks, {{"steps", sequence.steps.size()}, {"modes", modes}});
}

// Throws DeviceError where a light is not as it should be.
void check_lights(const CaptureProvenance& provenance, const capture::Rig& rig, core::Nanoseconds exposure) {
  capture::Sequence sequence = capture::make_light_check_sequence(provenance.stage.light_positions.size(), exposure);
  sequence.settle = provenance.sequence.settle;
  if (provenance.sequence.timing == capture::Timing::kFreeRun) sequence.timing = capture::Timing::kFreeRun;
  const capture::LightCheckReport report =
      capture::check_lights(provenance.stage.light_positions, capture::take_light_pictures(sequence, rig));
  const std::size_t lights = provenance.stage.light_positions.size();
  if (!report.too_little.empty()) core::warn("light check: " + report.too_little);
  if (report.findings.empty() && report.unjudged.size() == lights) {
    core::warn("light check: none of the lights could be judged; the pass goes on unchecked");
    return;
  }
  if (report.findings.empty()) {
    core::note("light check: nothing wrong with " + std::to_string(lights - report.unjudged.size()) + " of " +
               core::counted(lights, "light") +
               (report.unjudged.empty() ? "" : "; the others light nothing that a camera sees"));
    return;
  }
  std::string text;
  for (const capture::LightFinding& finding : report.findings) text += (text.empty() ? "" : "; ") + finding.text;
  throw core::DeviceError("light check: " + text + "; mend it, or go on with --no-light-check");
}

core::Nanoseconds exposure_of_lights(const capture::Sequence& sequence) {
  const auto light = std::find_if(sequence.steps.begin(), sequence.steps.end(),
                                  [](const db::Step& step) { return step.kind == db::StepKind::kLight; });
  return light == sequence.steps.end() ? sequence.steps.front().exposure_ns : light->exposure_ns;
}

std::string going_on(const db::Scan& scan) {
  return "go on with `lightstage capture --resume --name " + scan.name + "`";
}

void capture_scan(const Options& options, Context& context) {
  if (options.name.empty()) {
    throw core::UsageError(options.retake ? "--name NAME is needed: of which scan (lightstage store ls)"
                           : options.resume
                               ? "--name NAME is needed: which interrupted scan to go on with (lightstage store ls)"
                               : "--name NAME is needed: what the scan shall be called");
  }
  std::optional<capture::Preview> preview;
  if (!options.preview.empty() || !options.tev.empty()) {
    preview.emplace(
        capture::PreviewOptions{.every = options.preview_every, .still = options.preview, .tev_address = options.tev});
  }
  db::Store store = context.open_store();
  // Whether or not a scan of that name can be, before it is locked by it.
  if (options.goes_on()) {
    store.scan(options.name);
  } else if (!store.find_scan(options.name)) {
    store.require_free_name(options.name);
  }
  const db::ScanLock alone(store.folder(), options.name, "is being captured");
  std::optional<CaptureProvenance> planned;
  if (!options.goes_on()) planned = plan_capture(options.request);
  if (planned && store.find_scan(options.name)) {
    throw core::UsageError("scan '" + options.name + "' exists; take another --name, or go on with --resume");
  }
  if (!planned) planned = capture_provenance(store.scan(options.name));
  std::vector<db::Step> again;
  if (options.retake) {
    again = retake_steps(store, store.scan(options.name));
    planned->sequence.steps.insert(planned->sequence.steps.end(), again.begin(), again.end());
  }
  const CaptureProvenance& provenance = *planned;
  const std::size_t stated = provenance.exceeded_limits.size();
  const bool exceeds = options.goes_on()
                           ? require_rest_within_limits(store, options.name, *planned, options.request.i_know)
                           : stated > 0;
  require_room(store, options.name, provenance);
  // Opened before the scan is begun: a device that is missing leaves no empty scan behind.
  Devices devices(
      provenance,
      options.goes_on() ? capture::end_of_last_exposure(store, store.scan(options.name)) : core::Nanoseconds{0},
      exceeds);
  check_rig("scan '" + options.name + "'", provenance.sequence, devices.rig());
  // A mirror shows each light as a spot of its own: its neighbours say nothing of it.
  const bool mirror = !options.goes_on() && options.request.mirror_ball;
  if (mirror && options.light_check.value_or(false)) {
    throw core::UsageError(
        "--light-check: lights cannot be checked on a mirror ball; check them on the grey ball or the subject");
  }
  if (options.light_check.value_or(!provenance.simulation && !options.goes_on() && !mirror)) {
    check_lights(provenance, devices.rig(), exposure_of_lights(provenance.sequence));
  }
  if (options.retake || provenance.exceeded_limits.size() > stated)
    store.extend_scan(store.scan(options.name).id, again, to_json(provenance));
  const db::Scan scan =
      options.goes_on() ? store.scan(options.name) : begin_scan(store, options.name, options.request, provenance);

  capture::SessionOptions session;
  if (preview) {
    session.on_frame = [&](const db::Step&, const std::string& camera, const capture::CameraFrame& frame) {
      preview->show(camera, frame);
    };
  }
  capture::SessionReport report;
  try {
    report = run_session(store, scan, provenance.sequence, devices.rig(), session);
    if (scan.kind == db::ScanKind::kOlat && !store.newest_product("mask", scan.id)) store_subject_masks(store, scan);
  } catch (const core::Interrupted& interrupted) {
    throw core::Interrupted(interrupted.what() + ("; what was taken is stored: " + going_on(scan)));
  } catch (const core::StoreError& failure) {
    throw core::StoreError(
        failure.what() +
        ("; what was taken before is stored: mend that (where a disk is full, make room), then " + going_on(scan)));
  } catch (const core::DeviceError& failure) {
    throw core::DeviceError(failure.what() + ("; when that is mended, " + going_on(scan)));
  }

  const std::size_t frames = report.already_stored + report.stored;
  std::string text =
      "captured '" + scan.name + "': " + core::counted(frames, "frame") + " of " + core::counted(report.steps, "step");
  if (report.already_stored > 0) text += ", " + std::to_string(report.already_stored) + " of them stored before";
  text += "; " + std::to_string(report.dropped) + " dropped, " + std::to_string(report.discarded) + " discarded, " +
          std::to_string(report.retaken) + " retaken\n";
  const auto taken_again =
      std::count_if(again.begin(), again.end(), [](const db::Step& step) { return step.kind == db::StepKind::kLight; });
  if (taken_again > 0) {
    text += "taken again: " + core::counted(taken_again, "light") + "; now run `lightstage align " + scan.name + "`\n";
  }
  context.result(text, {{"scan", scan.name},
                        {"timing", to_string(provenance.sequence.timing)},
                        {"steps", report.steps},
                        {"frames", frames},
                        {"already_stored", report.already_stored},
                        {"stored", report.stored},
                        {"dropped", report.dropped},
                        {"discarded", report.discarded},
                        {"retaken", report.retaken},
                        {"taken_again", taken_again},
                        {"stage_seconds", double(report.duration) / core::kSecond}});
}

// Returns the options.
std::vector<CLI::Option*> add_simulation_options(CLI::App& command, CaptureRequest& request) {
  std::vector<CLI::Option*> options{
      command.add_option("--procedural", request.procedural_seed, "Subject: a procedural head, by seed")
          ->check(seed_number()),
      command.add_option("--mesh", request.mesh, "Subject: a mesh file (PLY, OBJ, glTF)"),
      command.add_option("--ball-radius", request.ball_radius_mm, "Radius of the ball, millimetres")
          ->capture_default_str()
          ->check(number_between(5.0, 500.0)),
      command.add_option("--yaw", request.yaw_degrees, "Turn the subject, degrees")->capture_default_str(),
      command.add_option("--at", request.at, "Where the subject stands: x,y,z in metres from stage centre")
          ->delimiter(',')
          ->expected(3)
          ->capture_default_str()
          ->check(number_between(-100.0, 100.0)),
      command.add_option("--size", request.size, "Picture width and height, pixels [the stage file's]")
          ->check(CLI::Range(16, 16384)),
      command.add_flag("--no-noise", request.no_noise, "A sensor without noise and quantisation"),
      command.add_flag("--no-motion", request.no_motion, "A subject that stands still"),
      command.add_flag("--bounce", request.bounce, "One bounce of indirect light"),
      command.add_option("--seed", request.seed, "Seed of noise, motion and faults")
          ->capture_default_str()
          ->check(seed_number()),
      command.add_option("--drop", request.drop, "Lose the frame of the n-th exposure (from 0), to see it retaken")};
  for (CLI::Option* option : options) option->group("Simulated stage");
  return options;
}

// Throws UsageError where one of the options was given.
void refuse_any(const std::vector<CLI::Option*>& options, const std::string& why) {
  for (const CLI::Option* option : options) {
    if (option->count() > 0) throw core::UsageError(option->get_name() + ": " + why);
  }
}

}  // namespace

void add_capture(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("capture", "Run a light sequence and store every frame");
  command->footer(
      "Ctrl-C stops between frames with the lights off; what was stored stays, and --resume goes on.\n"
      "Examples:\n"
      "  lightstage capture --stage stage.toml --dry-run        (how fast the devices go, in each timing mode)\n"
      "  lightstage capture --stage stage.toml --name head --preview live.png\n"
      "  lightstage capture --stage stage.toml --name shiny --exposure 5 --exposure 20 --exposure 80\n"
      "  lightstage capture --stage stage.toml --mirror-ball --name ball\n"
      "  lightstage capture --sim --procedural 7 --stage stage.toml --size 256 --name head\n"
      "  lightstage capture --resume --name head                (after an interruption)\n"
      "  lightstage capture --retake --name head                (lights that `align` left out; align again "
      "afterwards)");
  auto options = std::make_shared<Options>();
  CaptureRequest& request = options->request;
  command->add_option("--name", options->name, "Name of the scan");
  command->add_option("--stage", request.stage_file, "Stage file (lightstage stage; its devices: docs/hardware.md)");
  command->add_option("--sequence", request.sequence_file, "Sequence file; default: every light once");
  command->add_flag("--mirror-ball", request.mirror_ball, "On the stage stands a mirror ball, for `calibrate`");
  command->add_flag("--grey-ball", request.grey_ball, "On the stage stands a grey ball, for `calibrate --grey`");
  command->add_flag("--chessboard", request.chessboard,
                    "A chessboard is moved about on the stage, for `calibrate cameras`");
  command
      ->add_option("--views", request.board_views,
                   "Frames of the chessboard, all lights on; --settle (2 s here) is the time to move it")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  command->add_flag("--white-card", request.white_card,
                    "On the stage stands a white card that fills the pictures, for `calibrate flat --scan`");
  command
      ->add_option("--tracking-every", request.tracking_every,
                   "A tracking frame before every n-th light; 0: none [10, or more where that would flash too often]")
      ->check(CLI::Range(0, 100000));
  command->add_flag("--i-know", request.i_know,
                    "Take a sequence that flashes or heats more than [limits] of the stage file allow; nobody "
                    "photosensitive is there. It is recorded, and controllers keep their own limits");
  command
      ->add_option("--exposure", request.exposure_ms,
                   "Exposure of the single lights, milliseconds [20; white card 10; mirror ball 0.01, real stages "
                   "0.1]; given several times "
                   "every light is taken with each, and they are merged when the scan is loaded (high dynamic range)")
      ->take_all()
      ->check(number_between(0.0001, 10000.0));
  std::map<std::string, capture::Timing> timings;
  for (const capture::Timing timing : capture::kTimings) timings.emplace(to_string(timing), timing);
  command
      ->add_option("--timing", request.timing,
                   "lockstep, pipelined or free_run, instead of the sequence file's (docs/hardware.md)")
      ->transform(one_of(timings));
  command
      ->add_option("--settle", request.settle_ms,
                   "From switching lights to the exposure, milliseconds [2, or the sequence file's]")
      ->check(number_between(0.0, 60000.0));
  command->add_flag("--dry-run", options->dry_run,
                    "Store nothing: try the first 60 steps in every timing mode and say how fast it goes safely");
  command->add_flag("--light-check,!--no-light-check", options->light_check,
                    "Look for dead, swapped and double lights first [on real stages]");
  command->add_option("--preview", options->preview, "Write a still of a running pass to this picture file");
  command->add_option("--preview-every", options->preview_every, "A preview of every n-th frame")
      ->capture_default_str()
      ->check(CLI::Range(1, 100000));
  command->add_flag("--tev{127.0.0.1:14158}", options->tev,
                    "Show previews in the tev viewer that listens at 127.0.0.1:14158, or at --tev=HOST:PORT");
  command->add_flag("--resume", options->resume, "Go on with an interrupted capture of that name, as it was begun");
  CLI::Option* retake =
      command->add_flag("--retake", options->retake,
                        "Take the lights of that scan again that `align` left out, with tracking frames of their own");
  retake->excludes(command->get_option("--resume"));
  command->add_flag("--sim", request.simulate, "Capture on the simulated stage")->group("Simulated stage");
  const std::vector<CLI::Option*> simulated = add_simulation_options(*command, request);
  std::vector<CLI::Option*> new_ones = simulated;
  for (const char* name :
       {"--stage", "--sequence", "--sim", "--timing", "--settle", "--exposure", "--dry-run", "--mirror-ball",
        "--grey-ball", "--chessboard", "--white-card", "--views", "--tracking-every"}) {
    new_ones.push_back(command->get_option(name));
  }
  std::vector<CLI::Option*> not_dry;
  for (const char* name : {"--name", "--preview", "--preview-every", "--tev", "--light-check"}) {
    not_dry.push_back(command->get_option(name));
  }
  CLI::Option* views = command->get_option("--views");
  CLI::Option* tracking = command->get_option("--tracking-every");
  CLI::Option* radius = command->get_option("--ball-radius");
  command->callback([options, &context, simulated, new_ones, not_dry, views, tracking, radius] {
    if (options->goes_on()) {
      refuse_any(new_ones, std::string(options->resume ? "--resume" : "--retake") +
                               " goes on with a scan as it was begun; leave this out");
    }
    const CaptureRequest& asked = options->request;
    if (!options->goes_on() && !asked.chessboard) refuse_any({views}, "is for --chessboard; leave it out");
    if (asked.chessboard) refuse_any({tracking}, "a chessboard pass has no single lights; leave it out");
    if (asked.simulate && !asked.mirror_ball && !asked.grey_ball) {
      refuse_any({radius}, "is for --mirror-ball and --grey-ball; leave it out");
    }
    if (!asked.simulate) refuse_any(simulated, "is for simulated stages; add --sim, or leave it out");
    if (options->dry_run) {
      refuse_any(not_dry, "has no effect with --dry-run; leave it out");
      dry_run(*options, context);
    } else {
      capture_scan(*options, context);
    }
  });
}

}  // namespace lightstage::cli
