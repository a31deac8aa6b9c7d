#include "sim/timing_bench.h"

#include <algorithm>

#include "capture/stage.h"
#include "core/error.h"
#include "sim/world.h"

namespace lightstage::sim {

namespace {

constexpr double kLevelTolerance = 0.01;

Simulation small_simulation(const TimingBenchOptions& options) {
  capture::LayoutOptions layout;
  layout.lights = static_cast<std::size_t>(options.lights);
  layout.cameras = options.cameras;
  layout.camera_pixels = 16;
  Simulation simulation;
  simulation.stage = capture::make_stage("bench", layout);
  simulation.subject.kind = SubjectKind::kGreyBall;
  simulation.motion = {.amplitude_m = 0, .rotation_degrees = 0};
  simulation.faults.drop_probability = options.drop_probability;
  simulation.pixel_samples = 1;
  simulation.seed = options.seed;
  return simulation;
}

bool shows(const std::vector<capture::LightLevel>& seen, const std::vector<capture::LightLevel>& asked,
           std::size_t light_count) {
  std::vector<double> difference(light_count, 0);
  for (const capture::LightLevel& l : seen)
    difference[static_cast<std::size_t>(l.light_index)] += static_cast<double>(l.r);
  for (const capture::LightLevel& l : asked)
    difference[static_cast<std::size_t>(l.light_index)] -= static_cast<double>(l.r);
  return std::all_of(difference.begin(), difference.end(), [](double d) { return std::abs(d) <= kLevelTolerance; });
}

}  // namespace

std::vector<TimingRow> bench_timing(const TimingBenchOptions& options) {
  const World world(small_simulation(options));
  const std::vector<capture::StageCamera>& cameras = world.simulation().stage.cameras;
  const auto light_count = static_cast<std::size_t>(options.lights);
  capture::OlatOptions olat;
  olat.light_count = light_count;
  olat.exposure = options.exposure;
  capture::Sequence sequence = capture::make_olat_sequence(olat);
  sequence.settle = options.settle;

  std::vector<TimingRow> rows;
  for (const capture::Timing timing : capture::kTimings) {
    // There are no strobes of exposures that were asked for.
    if (timing == capture::Timing::kPipelined && !options.times.triggered) continue;
    core::VirtualClock clock;
    SimulatedRig rig(world, clock, options.times);
    TimingRow row{timing};
    capture::SessionOptions session;
    session.on_frame = [&](const db::Step& step, const std::string& camera, const capture::CameraFrame& frame) {
      const auto found = std::find_if(cameras.begin(), cameras.end(), [&](const auto& c) { return c.name == camera; });
      const auto camera_index = static_cast<std::size_t>(found - cameras.begin());
      const auto seen = rig.light_in_frame(camera_index, frame.sequence_number);
      if (!shows(seen, capture::levels(step, light_count), light_count)) ++row.wrong;
    };
    sequence.timing = timing;
    try {
      row.report = capture::dry_run(sequence, rig.rig(), session);
    } catch (const core::DeviceError& error) {
      row.problem = error.what();
    }
    const core::Nanoseconds passing = row.report.duration - row.report.preparation;
    row.steps_per_s = static_cast<double>(row.report.steps) * static_cast<double>(core::kSecond) /
                      static_cast<double>(std::max<core::Nanoseconds>(passing, 1));
    row.lights_left = rig.any_light_on();
    rows.push_back(row);
  }
  return rows;
}

}  // namespace lightstage::sim
