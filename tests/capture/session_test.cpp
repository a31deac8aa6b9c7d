#include "capture/session.h"

#include <catch2/catch.hpp>
#include <csignal>
#include <map>
#include <random>

#include "core/error.h"
#include "core/progress.h"
#include "fake_rig.h"
#include "support/support.h"

using namespace lightstage;
using capture::Sequence;
using capture::SessionReport;
using test::Delivery;
using test::FakeRig;

namespace {

constexpr std::size_t kLights = 6;

Sequence small_sequence() {
  capture::OlatOptions options;
  options.light_count = kLights;
  options.tracking_every = 3;
  options.dark_frames = 1;
  Sequence sequence = capture::make_olat_sequence(options);
  db::Step pattern;
  pattern.step_index = static_cast<int>(sequence.steps.size());
  pattern.kind = db::StepKind::kPattern;
  pattern.exposure_ns = 5 * core::kMillisecond;
  pattern.pattern = capture::pattern_of(std::vector<capture::LightLevel>{{1, 0.5f, 0, 0}, {4, 1, 1, 1}});
  sequence.steps.push_back(pattern);
  return sequence;
}

// A store with one scan, and the session on it.
struct Pass {
  explicit Pass(FakeRig& fake_rig, Sequence the_sequence = small_sequence())
      : fake(fake_rig), sequence(std::move(the_sequence)) {
    core::set_quiet(true);
    db::NewScan scan;
    scan.name = "pass";
    scan.stage_key = "fake";
    scan.cameras = fake.camera_names();
    scan.steps = sequence.steps;
    store.add_scan(scan);
  }

  SessionReport run(const capture::SessionOptions& options = {}) {
    return capture::run_session(store, store.scan("pass"), sequence, fake.rig(), options);
  }

  std::vector<db::Frame> frames() const { return store.frames(store.scan("pass").id); }

  // How many frames are stored, having checked that no step is there twice and that each shows its own step's
  // light.
  std::size_t check_pairing() const {
    std::set<std::pair<int, std::string>> seen;
    for (const db::Frame& frame : frames()) {
      const db::Step& step = sequence.steps.at(static_cast<std::size_t>(frame.step_index));
      CAPTURE(frame.step_index, frame.camera);
      REQUIRE(seen.emplace(frame.step_index, frame.camera).second);
      REQUIRE(store.object(frame.object)(1, 2) == FakeRig::value_for(capture::levels(step, kLights), kLights));
    }
    return seen.size();
  }

  std::size_t all() const { return sequence.steps.size() * fake.camera_names().size(); }

  FakeRig& fake;
  Sequence sequence;
  test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
};

// At the given exposures camera 0 does as scripted.
auto at(std::map<int, Delivery> script) {
  return [script = std::move(script)](std::size_t camera, int exposure) {
    const auto found = script.find(exposure);
    return camera == 0 && found != script.end() ? found->second : Delivery{};
  };
}

Delivery lost() {
  Delivery d;
  d.copies = 0;
  return d;
}
Delivery twice() {
  Delivery d;
  d.copies = 2;
  return d;
}
Delivery damaged() {
  Delivery d;
  d.damaged = true;
  return d;
}

}  // namespace

TEST_CASE("a pass without faults stores every step once and turns the lights off") {
  FakeRig fake(kLights, 2);
  Pass pass(fake);
  const SessionReport report = pass.run();
  CHECK(pass.check_pairing() == pass.all());
  CHECK(report.steps == pass.sequence.steps.size());
  CHECK(report.stored == pass.all());
  CHECK(report.already_stored == 0);
  CHECK(report.retaken + report.dropped + report.discarded == 0);
  CHECK(report.duration > 0);
  CHECK(fake.exposures() == static_cast<int>(pass.sequence.steps.size()));
  CHECK_FALSE(fake.any_light_on());
  CHECK(fake.all_off_calls() == 1);

  core::Nanoseconds last = -1;
  for (const db::Frame& frame : pass.store.frames(pass.store.scan("pass").id, "fake0")) {
    CHECK(frame.timestamp_ns > last);
    last = frame.timestamp_ns;
    CHECK(frame.attempt == 1);
    CHECK(frame.saturation == 4000);
    CHECK(frame.sequence_number == 100 + frame.step_index);
  }
}

TEST_CASE("the lights settle before every trigger") {
  FakeRig fake(kLights, 1);
  Sequence sequence = small_sequence();
  sequence.settle = 7 * core::kMillisecond;
  Pass pass(fake, sequence);
  pass.run();
  core::Nanoseconds expected = 0;
  for (const db::Frame& frame : pass.frames()) {
    expected += sequence.settle;
    CHECK(frame.timestamp_ns == expected);
    expected += sequence.steps[static_cast<std::size_t>(frame.step_index)].exposure_ns;
  }
  CHECK(capture::end_of_last_exposure(pass.store, pass.store.scan("pass")) == expected);
}

TEST_CASE("lost, duplicated and damaged frames are retaken or thrown away, and counted") {
  FakeRig fake(kLights, 2);
  // Exposures 2 and 3 are both of step 2: its first frame of camera 0 is lost.
  fake.delivery = at({{2, lost()}, {5, twice()}, {7, damaged()}});
  Pass pass(fake);
  const SessionReport report = pass.run();
  CHECK(pass.check_pairing() == pass.all());
  CHECK(report.dropped == 1);
  CHECK(report.retaken == 2);
  // The duplicate, the damaged one, and those of camera 1 that were exposed along with the two retakes.
  CHECK(report.discarded == 4);
  CHECK(fake.exposures() == static_cast<int>(pass.sequence.steps.size()) + 2);
  for (const db::Frame& frame : pass.frames()) {
    const bool retaken = frame.camera == "fake0" && (frame.step_index == 2 || frame.step_index == 6);
    CHECK(frame.attempt == (retaken ? 2 : 1));
  }
}

TEST_CASE("frames from before the session are never taken for its own") {
  FakeRig fake(kLights, 1);
  fake.add_stale_frame(0, 3, 0);
  fake.add_stale_frame(0, 4, 0);
  fake.add_stale_frame(0, 1'000'000'000, 0, true);  // damaged: its number means nothing
  Pass pass(fake);
  const SessionReport report = pass.run();
  CHECK(pass.check_pairing() == pass.all());
  CHECK(report.discarded == 3);
  CHECK(report.retaken == 0);
}

TEST_CASE("a frame that comes after its time-out is not given to the next try or step") {
  FakeRig fake(kLights, 1);
  Delivery late;
  // Beyond the time-out by less than the settling time: it arrives after the second trigger has been
  // prepared; and by more: in the middle of waiting for a later frame.
  late.late =
      500 * core::kMillisecond + GENERATE(1, 1 * core::kMillisecond, 10 * core::kMillisecond, 600 * core::kMillisecond);
  fake.delivery = at({{4, late}, {6, late}});
  Pass pass(fake);
  const SessionReport report = pass.run();
  CHECK(pass.check_pairing() == pass.all());
  CHECK(report.dropped == 2);
  CHECK(report.retaken == 2);
  // The latest may come when the pass has ended.
  CHECK((report.discarded == 1 || report.discarded == 2));
}

TEST_CASE("a frame that has no time-out left to come in is still waited for to the deadline") {
  FakeRig fake(kLights, 1);
  Delivery just_in_time;
  just_in_time.late = 500 * core::kMillisecond;
  fake.delivery = at({{4, just_in_time}});
  Pass pass(fake);
  const SessionReport report = pass.run();
  CHECK(pass.check_pairing() == pass.all());
  CHECK(report.dropped == 0);
}

TEST_CASE("a camera that never answers ends the session with its name, step and light, lights off") {
  FakeRig fake(kLights, 2);
  fake.delivery = [](std::size_t camera, int exposure) { return camera == 1 && exposure >= 4 ? lost() : Delivery{}; };
  Pass pass(fake);
  capture::SessionOptions options;
  options.attempts = 3;
  CHECK_THROWS_WITH(
      pass.run(options),
      "camera 'fake1' gave no good frame of step 4 (light, light 1) in 3 tries: the last one did not come in "
      "time; what was stored is kept, check the device and resume");
  CHECK_FALSE(fake.any_light_on());
  CHECK(fake.exposures() == 4 + 3);
  CHECK(pass.check_pairing() == 4 * 2 + 1);

  // Mended: only what is missing is taken.
  fake.delivery = [](std::size_t, int) { return Delivery{}; };
  const SessionReport report = pass.run(options);
  CHECK(report.already_stored == 9);
  CHECK(report.stored == pass.all() - 9);
  CHECK(pass.check_pairing() == pass.all());
}

TEST_CASE("an LED controller that fails now and then costs tries, one that stays deaf ends the session") {
  FakeRig fake(kLights, 1);
  fake.show_failures = {0, 5, 6};
  Pass pass(fake);
  const SessionReport report = pass.run();
  CHECK(pass.check_pairing() == pass.all());
  CHECK(report.retaken == 2);
  CHECK(fake.exposures() == static_cast<int>(pass.sequence.steps.size()));

  FakeRig deaf(kLights, 1);
  deaf.show_failures = {3, 4, 5, 6};
  Pass failing(deaf);
  CHECK_THROWS_WITH(failing.run(), Catch::Contains("step 3 (light, light 0) in 4 tries: fake LEDs: no answer"));
  CHECK_FALSE(deaf.any_light_on());
  CHECK(failing.check_pairing() == 3);
}

TEST_CASE("a camera that throws does not lose the other camera's frame") {
  FakeRig fake(kLights, 2);
  fake.delivery = [](std::size_t camera, int exposure) {
    Delivery d;
    d.raises_device_error = camera == 1 && exposure == 5;
    return d;
  };
  Pass pass(fake);
  const SessionReport report = pass.run();
  CHECK(pass.check_pairing() == pass.all());
  CHECK(report.retaken == 1);
}

TEST_CASE("a camera that fails while late frames are waited for costs a try") {
  FakeRig fake(kLights, 2);
  fake.delivery = [](std::size_t camera, int exposure) {
    Delivery d;
    d.raises_device_error = camera == 1 && exposure == 5;
    if (d.raises_device_error) d.late = 700 * core::kMillisecond;
    return d;
  };
  Pass pass(fake);
  CHECK(pass.run().retaken == 1);
  CHECK(pass.check_pairing() == pass.all());
}

TEST_CASE("a trigger that fails costs a try") {
  FakeRig fake(kLights, 1);
  int calls = 0;
  fake.on_fire = [&](int) {
    if (++calls == 4) throw core::DeviceError("fake trigger: stuck");
  };
  Pass pass(fake);
  CHECK(pass.run().retaken == 1);
  CHECK(pass.check_pairing() == pass.all());
}

TEST_CASE("a camera that runs free is reported instead of being listened to for ever") {
  FakeRig fake(kLights, 1);
  for (int i = 0; i < 5000; ++i) fake.add_stale_frame(0, i, 0);
  Pass pass(fake);
  capture::SessionOptions options;
  options.attempts = 1;
  CHECK_THROWS_WITH(pass.run(options), Catch::Contains("keeps sending frames that nobody asked for"));
  CHECK(pass.check_pairing() == 0);
}

TEST_CASE("a signal stops the pass between frames, with the lights off, and the pass resumes") {
  const int signal_number = GENERATE(SIGINT, SIGTERM);
  const int exposure_at_signal = GENERATE(0, 5, 11);
  FakeRig fake(kLights, 2);
  fake.on_fire = [&](int exposure) {
    if (exposure == exposure_at_signal) std::raise(signal_number);
  };
  Pass pass(fake);
  CHECK_THROWS_AS(pass.run(), core::Interrupted);
  CHECK_FALSE(fake.any_light_on());
  const std::size_t stored = static_cast<std::size_t>(exposure_at_signal + 1) * 2;
  CHECK(pass.check_pairing() == stored);
  const std::vector<db::Frame> before = pass.frames();

  fake.on_fire = [](int) {};
  const SessionReport report = pass.run();
  CHECK(report.already_stored == stored);
  CHECK(report.stored == pass.all() - stored);
  CHECK(pass.check_pairing() == pass.all());
  CHECK(fake.exposures() == static_cast<int>(pass.sequence.steps.size()));
  CHECK_FALSE(fake.any_light_on());
  // What was there was not touched.
  const std::vector<db::Frame> after = pass.frames();
  for (const db::Frame& frame : before) {
    const auto same = [&](const db::Frame& f) { return f.id == frame.id && f.timestamp_ns == frame.timestamp_ns; };
    CHECK(std::any_of(after.begin(), after.end(), same));
  }
  // And a third run finds nothing to do.
  CHECK(pass.run().stored == 0);
  CHECK(fake.exposures() == static_cast<int>(pass.sequence.steps.size()));
}

TEST_CASE("a signal during the last frame is not swallowed, but nothing is missing") {
  FakeRig fake(kLights, 1);
  Pass pass(fake);
  const int last = static_cast<int>(pass.sequence.steps.size()) - 1;
  fake.on_fire = [&](int exposure) {
    if (exposure == last) std::raise(SIGINT);
  };
  CHECK_THROWS_AS(pass.run(), core::Interrupted);
  CHECK(pass.check_pairing() == pass.all());
}

TEST_CASE("only the camera that misses a step is asked for it again when resuming") {
  FakeRig fake(kLights, 2);
  fake.delivery = [](std::size_t camera, int exposure) { return camera == 0 && exposure >= 3 ? lost() : Delivery{}; };
  Pass pass(fake);
  CHECK_THROWS_AS(pass.run(), core::DeviceError);
  const auto has = [&](const std::string& camera) {
    return pass.store.frames(pass.store.scan("pass").id, camera).size();
  };
  CHECK(has("fake0") == 3);
  CHECK(has("fake1") == 4);
  fake.delivery = [](std::size_t, int) { return Delivery{}; };
  const SessionReport report = pass.run();
  CHECK(report.stored == pass.all() - 7);
  CHECK(pass.check_pairing() == pass.all());
}

TEST_CASE("lights go off when the store refuses a frame") {
  FakeRig fake(kLights, 1);
  fake.on_fire = [&](int exposure) { fake.pictures_are_finite = exposure < 4; };
  Pass pass(fake);
  CHECK_THROWS_WITH(pass.run(), Catch::StartsWith("camera 'fake0', step 4 (light, light 1): "));
  CHECK_FALSE(fake.any_light_on());
  CHECK(pass.check_pairing() == 4);

  // Now and then: what is missing is taken again.
  fake.on_fire = [&](int exposure) { fake.pictures_are_finite = exposure % 5 != 0; };
  const SessionReport report = pass.run();
  CHECK(report.already_stored == 4);
  CHECK(report.stored == pass.all() - 4);
  CHECK(report.retaken > 0);
  CHECK(pass.check_pairing() == pass.all());
  CHECK_FALSE(fake.any_light_on());
}

TEST_CASE("a controller that is slow to obey is asked again to turn its lights off") {
  FakeRig fake(kLights, 1);
  fake.all_off_failures = 4;
  Pass pass(fake);
  pass.run();
  CHECK_FALSE(fake.any_light_on());
  CHECK(fake.all_off_calls() == 5);
}

TEST_CASE("lights that stay on are an error, but never hide another one") {
  FakeRig fake(kLights, 1);
  fake.all_off_failures = 1000;
  Pass pass(fake);
  CHECK_THROWS_WITH(pass.run(), "fake LEDs: deaf");

  FakeRig both(kLights, 1);
  both.all_off_failures = 1000;
  both.on_fire = [](int exposure) {
    if (exposure == 2) std::raise(SIGINT);
  };
  Pass interrupted(both);
  CHECK_THROWS_AS(interrupted.run(), core::Interrupted);
  CHECK(both.all_off_calls() == 5);
}

TEST_CASE("a session that does not fit its scan or rig lights nothing") {
  FakeRig fake(kLights, 2);
  Pass pass(fake);
  const db::Scan scan = pass.store.scan("pass");

  Sequence other = pass.sequence;
  other.steps[3].exposure_ns += 1;
  CHECK_THROWS_WITH(capture::run_session(pass.store, scan, other, fake.rig()),
                    "cannot capture scan 'pass': it was begun with another sequence; take that one, or another name");

  FakeRig one_camera(kLights, 1);
  CHECK_THROWS_WITH(capture::run_session(pass.store, scan, pass.sequence, one_camera.rig()),
                    "cannot capture scan 'pass': it was begun with the cameras fake0, fake1, the rig has fake0");

  FakeRig few_lights(kLights - 1, 2);
  CHECK_THROWS_WITH(capture::run_session(pass.store, scan, pass.sequence, few_lights.rig()),
                    Catch::Contains("light 5 is not one of the stage's 5"));
  CHECK(few_lights.shown().empty());
  CHECK(fake.shown().empty());

  capture::SessionOptions options;
  options.attempts = 0;
  CHECK_THROWS_AS(pass.run(options), core::UsageError);
}

TEST_CASE("whatever the cameras do, no frame is ever given to another step") {
  std::size_t retaken = 0, discarded = 0, dropped = 0, gave_up = 0;
  for (std::uint64_t seed = 0; seed < 16; ++seed) {
    CAPTURE(seed);
    std::mt19937_64 random(seed);
    const auto chance = [&](int percent) { return static_cast<int>(random() % 100) < percent; };
    const auto up_to = [&](core::Nanoseconds most) {
      return static_cast<core::Nanoseconds>(random() % static_cast<std::uint64_t>(most + 1));
    };
    FakeRig fake(kLights, 1 + seed % 2);
    fake.add_stale_frame(0, static_cast<std::int64_t>(random() % 100), 0, chance(30));
    fake.delivery = [&](std::size_t, int) {
      Delivery d;
      if (chance(12)) d.copies = 0;
      if (chance(12)) d.copies = 2 + static_cast<int>(random() % 3);
      d.damaged = chance(12);
      d.start_delay = chance(10) ? up_to(900 * core::kMillisecond) : up_to(core::kMillisecond);
      d.late = chance(15) ? up_to(2 * core::kSecond) : up_to(core::kMillisecond);
      d.raises_device_error = chance(3);
      return d;
    };
    Sequence sequence = small_sequence();
    sequence.settle = up_to(5 * core::kMillisecond);
    Pass pass(fake, sequence);
    for (int run = 0; pass.frames().size() < pass.all(); ++run) {
      REQUIRE(run < 200);
      try {
        const SessionReport report = pass.run();
        retaken += report.retaken;
        dropped += report.dropped;
        discarded += report.discarded;
      } catch (const core::DeviceError&) {
        ++gave_up;
      }
      REQUIRE_FALSE(fake.any_light_on());
    }
    REQUIRE(pass.check_pairing() == pass.all());
  }
  // The faults did happen.
  CHECK(retaken > 30);
  CHECK(dropped > 30);
  CHECK(discarded > 30);
  CHECK(gave_up > 0);
}
