#include "hil/scenarios/scenario.h"

#include <cmath>
#include <map>

#include <catch2/catch.hpp>

#include "capture/hardware_rig.h"
#include "hil/rig/scene.h"
#include "hil/scenarios/timed_rig.h"

namespace lightstage::hil {

namespace {

// The emulated cameras' full scale: level 1 fills it in 10 ms (uvc_camera.h), black is 1/64 of it.
constexpr core::Nanoseconds kFullScaleExposure = 10 * core::kMillisecond;
constexpr double kBlack = 1.0 / 64;

double top_code(const std::string& pixel_format) {
  return pixel_format == "Y16" || pixel_format == "RG16" ? 65535 : 255;
}

capture::CameraDevice camera_device(std::size_t index, const RigStage& options) {
  capture::CameraDevice device;
  device.match = "CAM" + std::to_string(index);
  device.pixel_format = options.pixel_formats[index];
  device.gain = 16;
  device.black_level = kBlack * top_code(device.pixel_format);
  // The emulated YUYV is linear, whatever its driver says.
  if (device.pixel_format == "YUYV") device.linearisation = {1, 0};
  device.triggered = !options.free_running;
  return device;
}

std::vector<std::size_t> cells_of(const capture::LightWiring& wiring) {
  std::vector<std::size_t> cells;
  for (const int channel : wiring.channels) {
    const auto number = static_cast<std::size_t>(channel);
    cells.push_back(wiring.controller == "dmx" ? kLedOutputs + number - 1 : number);
  }
  return cells;
}

// Radiance that every cell must show: red, green, blue.
std::map<std::size_t, std::array<double, 3>> expected_cells(const db::Step& step, const capture::Stage& stage) {
  std::map<std::size_t, std::array<double, 3>> cells;
  for (const capture::LightLevel& l : capture::levels(step, stage.light_positions.size())) {
    const auto wiring = stage.hardware.wiring.at(static_cast<std::size_t>(l.light_index));
    for (const std::size_t cell : cells_of(wiring)) cells[cell] = {l.r, l.g, l.b};
  }
  return cells;
}

// Empty when the picture shows the step's light and nothing else.
std::string difference(core::ImageView image, const db::Step& step, const capture::Stage& stage, double tolerance) {
  const auto expected = expected_cells(step, stage);
  const int cell_width = image.width() / int{kCellColumns}, cell_height = image.height() / int{kCellRows};
  for (std::size_t cell = 0; cell < kCells; ++cell) {
    const int x = static_cast<int>(cell % kCellColumns) * cell_width + cell_width / 2;
    const int y = static_cast<int>(cell / kCellColumns) * cell_height + cell_height / 2;
    const auto found = expected.find(cell);
    std::array<double, 3> want = found == expected.end() ? std::array<double, 3>{} : found->second;
    if (image.channels() == 1) want[0] = (want[0] + want[1] + want[2]) / 3;
    for (int c = 0; c < image.channels(); ++c) {
      const double got = image(y, x, c);
      if (std::abs(got - want[static_cast<std::size_t>(c)]) <= tolerance) continue;
      return "cell " + std::to_string(cell) + " shows " + std::to_string(got) + " instead of " +
             std::to_string(want[static_cast<std::size_t>(c)]);
    }
  }
  return "";
}

// Two codes of the camera, or half a percent.
double tolerance(const db::Step& step, const std::string& pixel_format) {
  const double code =
      static_cast<double>(kFullScaleExposure) / static_cast<double>(step.exposure_ns) / top_code(pixel_format);
  return std::max(2 * code, 0.005);
}

}  // namespace

capture::Stage make_rig_stage(const RigStage& options) {
  capture::LayoutOptions layout;
  layout.lights = options.lights;
  layout.cameras = static_cast<int>(options.pixel_formats.size());
  capture::Stage stage = capture::make_stage("emulated", layout);
  stage.hardware.controllers = {options.dmx
                                    ? capture::ControllerSpec{"dmx", capture::ControllerKind::kEnttecDmxUsbPro, "DMX0"}
                                    : capture::ControllerSpec{"dome", capture::ControllerKind::kLightstage, "LED0"}};
  for (std::size_t i = 0; i < options.lights; ++i) {
    // DMX channels count from 1.
    stage.hardware.wiring.push_back(
        {stage.hardware.controllers[0].name, {static_cast<int>(i) + (options.dmx ? 1 : 0)}});
  }
  for (std::size_t i = 0; i < stage.cameras.size(); ++i) {
    capture::StageCamera& camera = stage.cameras[i];
    camera.model.width = options.width;
    camera.model.height = options.width * 3 / 4;
    camera.responsivity = static_cast<double>(core::kSecond) / static_cast<double>(kFullScaleExposure) / (1 - kBlack);
    stage.hardware.cameras.push_back(camera_device(i, options));
  }
  if (!options.free_running) {
    stage.hardware.trigger = capture::TriggerSpec{"cp2112_gpio", {"0", "1"}};
    stage.hardware.trigger->lines.resize(stage.cameras.size());
    if (options.common_trigger) stage.hardware.trigger->lines = {"4"};
  }
  if (options.strobe) stage.hardware.strobe = capture::StrobeSpec{"cp2112_gpio", "6"};
  // Through the file that a lab would write.
  return capture::parse_stage(capture::to_toml(stage), "emulated.toml");
}

namespace {
void switch_cameras(const std::string& mode) {
  for (const char* camera : {"cam0", "cam1"}) EmulatedRig::instance().command(mode + " " + camera);
}
}  // namespace

FreeRunningCameras::FreeRunningCameras(bool free_running) {
  switch_cameras(free_running ? "free" : "triggered");
}
FreeRunningCameras::~FreeRunningCameras() {
  switch_cameras("triggered");
}

capture::Sequence make_rig_sequence(const capture::Stage& stage, const PassOptions& options) {
  capture::Sequence sequence = capture::make_olat_sequence({.light_count = stage.light_positions.size(),
                                                            .tracking_every = options.tracking_every,
                                                            .exposure = options.exposure,
                                                            .full_on_exposure = options.exposure});
  sequence.timing = options.timing;
  return sequence;
}

StoreCheck check_store(const db::Store& store, const db::Scan& scan, const capture::Stage& stage) {
  StoreCheck check;
  for (std::size_t i = 0; i < stage.cameras.size(); ++i) {
    const std::string& camera = stage.cameras[i].name;
    std::map<int, db::Frame> frames;
    for (const db::Frame& frame : store.frames(scan.id, camera)) frames.emplace(frame.step_index, frame);
    for (const db::Step& step : scan.steps) {
      const auto frame = frames.find(step.step_index);
      if (frame == frames.end()) {
        ++check.missing;
        continue;
      }
      ++check.frames;
      const std::string problem = difference(store.object(frame->second.object), step, stage,
                                             tolerance(step, stage.hardware.cameras[i].pixel_format));
      if (problem.empty()) continue;
      if (check.wrong++ == 0)
        check.first_wrong = "step " + std::to_string(step.step_index) + " of " + camera + ": " + problem;
    }
  }
  return check;
}

Scenario::Scenario(const std::string& name) : report_(name), store_(db::Store::create(folder_ / "store")) {
  EmulatedRig::instance().command("begin " + name);
}

void Scenario::fault(const std::string& line) {
  EmulatedRig::instance().command(line);
  report_.add_fault();
}

void Scenario::add_scan(const capture::Stage& stage, const capture::Sequence& sequence) {
  db::NewScan scan{.name = "pass", .stage_key = capture::stage_key(stage), .steps = sequence.steps};
  for (const capture::StageCamera& camera : stage.cameras) scan.cameras.push_back(camera.name);
  store_.add_scan(scan);
}

capture::SessionReport Scenario::capture(const capture::Stage& stage, const capture::Sequence& sequence,
                                         const capture::SessionOptions& options) {
  if (!store_.find_scan("pass")) add_scan(stage, sequence);
  capture::HardwareRig hardware(stage, clock_);
  const capture::SessionReport report =
      capture::run_session(store_, store_.scan("pass"), sequence, hardware.rig(), options);
  report_.add_retaken(report.retaken);
  return report;
}

capture::SessionReport Scenario::dry_run(const capture::Stage& stage, const capture::Sequence& sequence) {
  capture::HardwareRig hardware(stage, clock_);
  TimedRig timed(hardware.rig());
  const capture::SessionReport report = capture::dry_run(sequence, timed.rig());
  trigger_to_frame_ms_ = timed.mean_latency_ms();
  return report;
}

void Scenario::require_all_right(const capture::Stage& stage) {
  const nlohmann::json state = EmulatedRig::instance().state();
  const StoreCheck check = check_store(store_, store_.scan("pass"), stage);
  report_.add_frame(check.frames + check.missing);
  report_.set_wrong(check.wrong);
  report_.set_lights_left_on(state["lit"]);
  INFO(check.first_wrong);
  REQUIRE(check.missing == 0);
  REQUIRE(check.wrong == 0);
  REQUIRE(state["lit"] == 0);
  REQUIRE(state["script"] == 0);
  report_.pass();
}

}  // namespace lightstage::hil
