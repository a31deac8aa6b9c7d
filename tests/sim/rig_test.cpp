#include "sim/rig.h"

#include <catch2/catch.hpp>
#include <map>
#include <set>

#include "capture/session.h"
#include "core/error.h"
#include "core/progress.h"
#include "sim/sensor.h"
#include "support/support.h"

using namespace lightstage;
using capture::CameraFrame;
using capture::LightLevel;
using core::kMillisecond;
using core::Nanoseconds;

namespace {

constexpr std::size_t kLights = 12;

sim::Simulation small_simulation(int cameras = 2) {
  capture::LayoutOptions layout;
  layout.lights = kLights;
  layout.camera_pixels = 24;
  layout.cameras = cameras;
  sim::Simulation simulation;
  simulation.stage = capture::make_stage("test", layout);
  simulation.subject.kind = sim::SubjectKind::kGreyBall;
  simulation.subject.size_m = 0.12;
  simulation.pixel_samples = 1;
  simulation.seed = 11;
  return simulation;
}

sim::Simulation without_noise(int cameras = 1) {
  sim::Simulation simulation = small_simulation(cameras);
  simulation.sensor.noise = false;
  simulation.faults.trigger_jitter = 0;
  return simulation;
}

capture::Sequence sequence() {
  capture::OlatOptions options;
  options.light_count = kLights;
  options.tracking_every = 4;
  options.dark_frames = 2;
  return capture::make_olat_sequence(options);
}

db::Scan add_scan(db::Store& store, const sim::Simulation& simulation, const capture::Sequence& steps) {
  core::set_quiet(true);
  db::NewScan scan;
  scan.name = "pass";
  scan.stage_key = capture::stage_key(simulation.stage);
  for (const capture::StageCamera& camera : simulation.stage.cameras) scan.cameras.push_back(camera.name);
  scan.steps = steps.steps;
  return store.scan(store.add_scan(scan));
}

double distance(core::ImageView a, core::ImageView b) {
  double sum = 0;
  for (int y = 0; y < a.height(); ++y) {
    for (int x = 0; x < a.width(); ++x) {
      for (int c = 0; c < a.channels(); ++c) {
        sum += std::pow(static_cast<double>(a(y, x, c)) - static_cast<double>(b(y, x, c)), 2);
      }
    }
  }
  return sum;
}

// Every step once for every camera, and the picture of each light is that light's, of all lights'.
void check_pass(const db::Store& store, const sim::World& world, const capture::Sequence& steps) {
  const sim::Simulation& simulation = world.simulation();
  const db::Scan scan = store.scan("pass");
  for (const capture::StageCamera& camera : simulation.stage.cameras) {
    const std::vector<db::Frame> frames = store.frames(scan.id, camera.name);
    REQUIRE(frames.size() == steps.steps.size());
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const db::Step& step = steps.steps[i];
      REQUIRE(frames[i].step_index == step.step_index);
      const core::Image image = store.object(frames[i].object);
      const auto expected = [&](std::span<const LightLevel> levels) {
        sim::SensorSpec clean = simulation.sensor;
        clean.noise = false;
        const Nanoseconds middle = frames[i].timestamp_ns + step.exposure_ns / 2;
        return sim::sense(world.render(camera.model, levels, middle), clean, camera.responsivity, step.exposure_ns, 0);
      };
      const double own = distance(image, expected(capture::levels(step, kLights)));
      CAPTURE(camera.name, step.step_index, own);
      // Noise of 1 or 2 % of the scale in each value (the scale is 1.1 for single lights).
      const double scale = sim::saturation_radiance(camera.responsivity, step.exposure_ns);
      REQUIRE(own < 24 * 24 * 3 * std::pow(0.01 * scale, 2));
      if (step.kind != db::StepKind::kLight) continue;
      for (int light = 0; light < static_cast<int>(kLights); ++light) {
        const std::vector<LightLevel> other{{light}};
        if (light != *step.light_index) REQUIRE(own < distance(image, expected(other)));
      }
    }
  }
}

// One frame of camera `index` under the given lights, `lit_for` after they were switched on.
CameraFrame shoot(capture::Rig& rig, std::span<const LightLevel> levels, Nanoseconds lit_for, Nanoseconds exposure,
                  std::size_t index = 0) {
  rig.lights.show(levels);
  rig.clock.sleep_until(rig.clock.now() + lit_for);
  for (capture::Camera* camera : rig.cameras) camera->set_exposure(exposure);
  rig.trigger->fire();
  auto frame = rig.cameras[index]->wait_frame(rig.clock.now() + exposure + core::kSecond);
  REQUIRE(frame);
  return std::move(*frame);
}

}  // namespace

TEST_CASE("a simulated pass with every fault ends with each step once, lit by its own light") {
  sim::Simulation simulation = small_simulation();
  simulation.faults.drop_exposures = {3, 9};
  simulation.faults.duplicate_exposures = {0, 5, 6};
  simulation.faults.damage_exposures = {7, 12};
  simulation.faults.light_timeouts = {2, 11};
  simulation.faults.drop_probability = 0.05;
  const sim::World world(simulation);
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  const capture::Sequence steps = sequence();
  const db::Scan scan = add_scan(store, simulation, steps);
  core::VirtualClock clock;
  sim::SimulatedRig rig(world, clock);
  const capture::SessionReport report = capture::run_session(store, scan, steps, rig.rig());

  check_pass(store, world, steps);
  CHECK_FALSE(rig.any_light_on());
  CHECK(report.stored == 2 * steps.steps.size());
  CHECK(report.dropped >= 2 * 2);
  CHECK(report.discarded >= 3 * 2 + 2 * 2);
  CHECK(report.retaken >= 2 * (2 + 2));
  CHECK(rig.exposures() > static_cast<int>(steps.steps.size()));
}

TEST_CASE("a simulated pass is the same every time, and another one for another seed") {
  const auto capture_with = [](std::uint64_t seed) {
    sim::Simulation simulation = small_simulation(1);
    simulation.seed = seed;
    simulation.faults.drop_probability = 0.2;
    const sim::World world(simulation);
    const test::TemporaryFolder folder;
    db::Store store = db::Store::create(folder / "store");
    const capture::Sequence steps = sequence();
    const db::Scan scan = add_scan(store, simulation, steps);
    core::VirtualClock clock;
    sim::SimulatedRig rig(world, clock);
    capture::run_session(store, scan, steps, rig.rig());
    std::vector<std::pair<Nanoseconds, std::string>> frames;
    for (const db::Frame& frame : store.frames(scan.id)) frames.emplace_back(frame.timestamp_ns, frame.object.hex());
    return frames;
  };
  const auto first = capture_with(1);
  CHECK(first == capture_with(1));
  CHECK_FALSE(first == capture_with(2));
}

TEST_CASE("a pass that is resumed goes on in time, with another rig") {
  struct Unplugged : capture::Trigger {
    Unplugged(capture::Trigger& trigger, int works_for) : inner(trigger), left(works_for) {}
    core::Nanoseconds fire() override {
      if (left-- <= 0) throw core::DeviceError("unplugged");
      return inner.fire();
    }
    capture::Trigger& inner;
    int left;
  };
  const sim::Simulation simulation = small_simulation(1);
  const sim::World world(simulation);
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  const capture::Sequence steps = sequence();
  const db::Scan scan = add_scan(store, simulation, steps);
  CHECK(capture::end_of_last_exposure(store, scan) == 0);
  {
    core::VirtualClock clock;
    sim::SimulatedRig rig(world, clock);
    const capture::Rig whole = rig.rig();
    Unplugged trigger(*whole.trigger, 8);
    CHECK_THROWS_AS(capture::run_session(store, scan, steps, {whole.lights, &trigger, whole.cameras, clock}),
                    core::DeviceError);
    CHECK_FALSE(rig.any_light_on());
  }
  CHECK(store.frames(scan.id).size() == 8);
  {
    core::VirtualClock clock;
    clock.sleep_until(capture::end_of_last_exposure(store, scan));
    sim::SimulatedRig rig(world, clock);
    const capture::SessionReport report = capture::run_session(store, scan, steps, rig.rig());
    CHECK(report.already_stored == 8);
  }
  check_pass(store, world, steps);
  const std::vector<db::Frame> frames = store.frames(scan.id);
  std::set<std::string> dark;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (i > 0) CHECK(frames[i].timestamp_ns > frames[i - 1].timestamp_ns);
    if (steps.steps[i].kind == db::StepKind::kDark) dark.insert(frames[i].object.hex());
  }
  CHECK(dark.size() == 2);  // noise never repeats
}

TEST_CASE("listed faults happen at their exposures, and only there") {
  sim::Simulation simulation = small_simulation(1);
  simulation.faults.drop_exposures = {1};
  simulation.faults.duplicate_exposures = {2};
  simulation.faults.damage_exposures = {3};
  simulation.faults.light_timeouts = {1};
  const sim::World world(simulation);
  core::VirtualClock clock;
  sim::SimulatedRig simulated(world, clock);
  const capture::Rig rig = simulated.rig();
  capture::Camera& camera = *rig.cameras[0];
  const std::vector<LightLevel> light{{3}};

  rig.lights.show(light);
  CHECK(simulated.any_light_on());
  CHECK_THROWS_AS(rig.lights.show(std::vector<LightLevel>{}), core::DeviceError);
  CHECK(simulated.any_light_on());  // a controller that did not answer has not switched
  camera.set_exposure(kMillisecond);
  const auto fire = [&] {
    rig.trigger->fire();
    return camera.wait_frame(clock.now() + 10 * kMillisecond);
  };
  const auto first = fire();
  REQUIRE(first);
  CHECK(first->sequence_number == 0);
  CHECK_FALSE(first->damaged);
  CHECK_FALSE(fire());
  const auto third = fire();
  const auto again = camera.wait_frame(clock.now());
  REQUIRE((third && again));
  CHECK(third->sequence_number == 2);
  CHECK((again->sequence_number == 2 && again->timestamp == third->timestamp && again->image == third->image));
  CHECK_FALSE(camera.wait_frame(clock.now()));
  const auto fourth = fire();
  REQUIRE(fourth);
  CHECK(fourth->damaged);
  for (int x = 0; x < 24; ++x) CHECK(fourth->image(23, x, 1) == 0);
  CHECK(simulated.exposures() == 4);
}

TEST_CASE("frames come when their exposure ends, and not before") {
  const sim::World world(without_noise());
  core::VirtualClock clock;
  sim::SimulatedRig simulated(world, clock);
  const capture::Rig rig = simulated.rig();
  capture::Camera& camera = *rig.cameras[0];
  CHECK_THROWS_AS(rig.trigger->fire(), core::DeviceError);  // no exposure was set
  camera.set_exposure(20 * kMillisecond);
  clock.sleep_until(core::kSecond);
  rig.trigger->fire();
  CHECK_FALSE(camera.wait_frame(clock.now()));
  CHECK_FALSE(camera.wait_frame(core::kSecond + 19 * kMillisecond));
  CHECK(clock.now() == core::kSecond + 19 * kMillisecond);
  rig.trigger->fire();  // missed: the camera is exposing
  const auto frame = camera.wait_frame(3 * core::kSecond);
  REQUIRE(frame);
  CHECK(clock.now() == core::kSecond + 20 * kMillisecond);
  CHECK(frame->timestamp == core::kSecond);
  CHECK(frame->saturation == Approx(1 / 0.9));
  CHECK_FALSE(camera.wait_frame(2 * core::kSecond));
  CHECK(clock.now() == 2 * core::kSecond);
  CHECK_THROWS_AS(camera.set_exposure(999), core::DeviceError);
  CHECK_THROWS_AS(camera.set_exposure(11 * core::kSecond), core::DeviceError);
}

TEST_CASE("the trigger's jitter has its standard deviation and never begins early") {
  sim::Simulation simulation = small_simulation(2);
  simulation.faults.drop_exposures = {};
  const sim::World world(simulation);
  core::VirtualClock clock;
  sim::SimulatedRig simulated(world, clock);
  const capture::Rig rig = simulated.rig();
  for (capture::Camera* camera : rig.cameras) camera->set_exposure(1000);
  std::vector<double> delays;
  bool cameras_differ = false;
  for (int i = 0; i < 300; ++i) {
    clock.sleep_until(clock.now() + kMillisecond);
    const Nanoseconds fired = clock.now();
    rig.trigger->fire();
    std::vector<Nanoseconds> starts;
    for (capture::Camera* camera : rig.cameras) {
      const auto frame = camera->wait_frame(fired + 10 * kMillisecond);
      REQUIRE(frame);
      starts.push_back(frame->timestamp);
      REQUIRE(frame->timestamp >= fired);
      delays.push_back(static_cast<double>(frame->timestamp - fired));
    }
    cameras_differ = cameras_differ || starts[0] != starts[1];
  }
  double mean = 0, variance = 0;
  for (const double d : delays) mean += d / 600;
  for (const double d : delays) variance += (d - mean) * (d - mean) / 599;
  CHECK(mean == Approx(200'000).epsilon(0.05));
  CHECK(std::sqrt(variance) == Approx(50'000).epsilon(0.12));
  CHECK(cameras_differ);
}

TEST_CASE("a frame is the world at the middle of its exposure under the mean of its lights") {
  sim::Simulation simulation = without_noise();
  simulation.faults.rise_time = 20 * kMillisecond;
  simulation.sensor.vignetting = 0;
  const sim::World world(simulation);
  core::VirtualClock clock;
  clock.sleep_until(7 * core::kSecond);
  sim::SimulatedRig simulated(world, clock);
  capture::Rig rig = simulated.rig();
  const Nanoseconds exposure = 20 * kMillisecond;
  const std::vector<LightLevel> full{{2}, {5, 0.5f, 0.25f, 0}};
  const CameraFrame frame = shoot(rig, full, 0, exposure);

  // Over the first rise time the mean of 1 - exp(-t) is exp(-1).
  const auto e = static_cast<float>(std::exp(-1.0));
  const std::vector<LightLevel> mean{{2, e, e, e}, {5, 0.5f * e, 0.25f * e, 0}};
  const core::Image expected = world.render(simulation.stage.cameras[0].model, mean, frame.timestamp + exposure / 2);
  CHECK(distance(expected, core::Image(expected.size())) > 0.1);
  CHECK(distance(frame.image, expected) < 1e-9);
  CHECK(frame.timestamp == 7 * core::kSecond);
}

TEST_CASE("the picture depends on the clock's time, not on what was shot before") {
  const sim::World world(small_simulation(1));
  const std::vector<LightLevel> light{{4}};
  core::VirtualClock early, late;
  sim::SimulatedRig one(world, early), two(world, late);
  capture::Rig first = one.rig(), second = two.rig();
  for (int i = 0; i < 5; ++i) shoot(first, light, kMillisecond, kMillisecond);
  early.sleep_until(core::kSecond);
  late.sleep_until(core::kSecond);
  const CameraFrame a = shoot(first, light, 50 * kMillisecond, 20 * kMillisecond);
  const CameraFrame b = shoot(second, light, 50 * kMillisecond, 20 * kMillisecond);
  CHECK(a.timestamp == b.timestamp);
  CHECK(distance(a.image, b.image) < 1e-9);
  CHECK(a.sequence_number == 5);
  CHECK(b.sequence_number == 0);
}

TEST_CASE("the simulated controller shows only what it can") {
  const sim::World world(small_simulation(1));
  core::VirtualClock clock;
  sim::SimulatedRig simulated(world, clock);
  const capture::Rig rig = simulated.rig();
  CHECK(rig.lights.light_count() == kLights);
  for (const LightLevel& bad : {LightLevel{-1}, LightLevel{12}, LightLevel{0, 1.5f}, LightLevel{0, 1, -0.1f},
                                LightLevel{0, 1, 1, std::numeric_limits<float>::quiet_NaN()}}) {
    CHECK_THROWS_AS(rig.lights.show(std::vector<LightLevel>{bad}), core::DeviceError);
  }
  CHECK_FALSE(simulated.any_light_on());
  rig.lights.show(std::vector<LightLevel>{{11}});
  CHECK(simulated.any_light_on());
  rig.lights.all_off();
  CHECK_FALSE(simulated.any_light_on());
}
