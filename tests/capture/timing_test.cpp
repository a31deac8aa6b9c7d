// The fast timing modes on scripted devices. What a frame shows is compared with its step's light.
#include <catch2/catch.hpp>
#include <csignal>
#include <map>
#include <random>

#include "capture/session.h"
#include "core/error.h"
#include "core/progress.h"
#include "fake_rig.h"
#include "support/support.h"

using namespace lightstage;
using capture::Sequence;
using capture::SessionReport;
using capture::Timing;
using core::kMillisecond;
using test::Delivery;
using test::FakeRig;

namespace {

constexpr std::size_t kLights = 40;

Sequence olat(Timing timing, core::Nanoseconds exposure = 8 * kMillisecond) {
  capture::OlatOptions options;
  options.light_count = kLights;
  options.tracking_every = 8;
  options.exposure = exposure;
  options.full_on_exposure = exposure;
  Sequence sequence = capture::make_olat_sequence(options);
  sequence.timing = timing;
  return sequence;
}

// As a lab's devices: a millisecond for a command, a frame's way of 12 ms, cameras of 60 pictures a second.
void be_real(FakeRig& fake) {
  fake.command_time = kMillisecond;
  fake.fire_time = kMillisecond / 2;
  fake.strobe_time = kMillisecond / 5;
  fake.least_period = 50 * kMillisecond / 3;
  fake.phase_of_camera = 3 * kMillisecond;
  fake.holds_sequences = true;
  fake.delivery = [](std::size_t, int) {
    Delivery d;
    d.late = 12 * kMillisecond;
    d.start_delay = kMillisecond / 10;
    return d;
  };
}

struct Pass {
  Pass(FakeRig& the_fake, Sequence the_sequence) : fake(the_fake), sequence(std::move(the_sequence)) {
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
  // How many frames show another light than their step's.
  std::size_t wrong() const {
    std::size_t count = 0;
    for (const db::Frame& frame : store.frames(store.scan("pass").id)) {
      const db::Step& step = sequence.steps.at(static_cast<std::size_t>(frame.step_index));
      if (store.object(frame.object)(1, 2) != FakeRig::value_for(capture::levels(step, kLights), kLights)) ++count;
    }
    return count;
  }
  std::size_t stored() const { return store.frames(store.scan("pass").id).size(); }
  std::size_t all() const { return sequence.steps.size() * fake.camera_names().size(); }

  FakeRig& fake;
  Sequence sequence;
  test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
};

}  // namespace

TEST_CASE("every timing mode stores the same pictures, the fast ones sooner", "[timing]") {
  std::map<Timing, core::Nanoseconds> duration;
  for (const Timing timing : {Timing::kLockstep, Timing::kPipelined, Timing::kFreeRun}) {
    CAPTURE(capture::to_string(timing));
    FakeRig fake(kLights, 2);
    be_real(fake);
    Pass pass(fake, olat(timing));
    const SessionReport report = pass.run();
    CHECK(pass.stored() == pass.all());
    CHECK(pass.wrong() == 0);
    CHECK(report.retaken == 0);
    CHECK(report.dropped == 0);
    CHECK_FALSE(fake.any_light_on());
    duration[timing] = report.duration - report.preparation;
  }
  CHECK(duration[Timing::kPipelined] < duration[Timing::kLockstep]);
}

TEST_CASE("whatever is lost, late, doubled or damaged, every mode ends with every frame under its own light",
          "[timing]") {
  const Timing timing = GENERATE(Timing::kPipelined, Timing::kFreeRun);
  CAPTURE(capture::to_string(timing));
  std::size_t retaken = 0;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    CAPTURE(seed);
    std::mt19937_64 random(seed);
    const auto chance = [&](int percent) { return static_cast<int>(random() % 100) < percent; };
    const auto up_to = [&](core::Nanoseconds most) {
      return static_cast<core::Nanoseconds>(random() % static_cast<std::uint64_t>(most + 1));
    };
    FakeRig fake(kLights, 1 + seed % 2);
    be_real(fake);
    fake.delivery = [&](std::size_t, int exposure) {
      Delivery d;
      d.late = 12 * kMillisecond + up_to(2 * kMillisecond);
      d.stamp_late = seed % 3 == 0 ? 0 : 9 * kMillisecond + up_to(kMillisecond);  // stamped on arrival
      d.start_delay = timing == Timing::kFreeRun ? 0 : up_to(kMillisecond / 2);
      if (exposure < 200 && timing == Timing::kFreeRun) return d;  // while it is measured
      if (exposure < 6) return d;
      if (chance(3)) d.copies = 0;
      if (chance(3)) d.copies = 2;
      if (chance(3)) d.swallowed = true;
      d.damaged = chance(3);
      if (chance(2)) d.late += up_to(200 * kMillisecond);
      if (chance(2)) d.stamp_late += up_to(100 * kMillisecond);
      return d;
    };
    if (timing == Timing::kPipelined) fake.strobe_failures = {15, 31};
    Pass pass(fake, olat(timing));
    capture::SessionOptions options;
    options.attempts = 12;
    const SessionReport report = pass.run(options);
    CHECK(pass.stored() == pass.all());
    CHECK(pass.wrong() == 0);
    CHECK_FALSE(fake.any_light_on());
    retaken += report.retaken;
  }
  CHECK(retaken > 0);
}

TEST_CASE("a rig that cannot do a timing mode is refused before anything is lit", "[timing]") {
  FakeRig fake(kLights, 1);
  Pass pipelined(fake, olat(Timing::kPipelined));
  CHECK_THROWS_WITH(pipelined.run(), Catch::Contains("pipelined needs LED controllers that hold a sequence"));
  CHECK(fake.shown().empty());

  Sequence sequence = olat(Timing::kLockstep);
  const capture::Rig whole = fake.rig();
  const capture::Rig without_trigger{whole.lights, nullptr, whole.cameras, whole.clock};
  CHECK_THROWS_WITH(capture::dry_run(sequence, without_trigger), Catch::Contains("lockstep needs a trigger"));
  CHECK(fake.shown().empty());
}

TEST_CASE("an interrupted fast pass keeps what is certain and goes on", "[timing]") {
  const Timing timing = GENERATE(Timing::kPipelined, Timing::kFreeRun);
  CAPTURE(capture::to_string(timing));
  FakeRig fake(kLights, 1);
  be_real(fake);
  const auto delivery = fake.delivery;
  int exposures = 0;
  fake.delivery = [&](std::size_t camera, int exposure) {
    if (++exposures == (timing == Timing::kPipelined ? 24 : 205)) std::raise(SIGINT);
    return delivery(camera, exposure);
  };
  Pass pass(fake, olat(timing));
  CHECK_THROWS_AS(pass.run(), core::Interrupted);
  CHECK_FALSE(fake.any_light_on());
  CHECK(pass.stored() < pass.all());
  CHECK(pass.wrong() == 0);
  pass.run();
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
}

TEST_CASE("a controller that fails during a fast pass costs steps, not the pass", "[timing]") {
  const Timing timing = GENERATE(Timing::kPipelined, Timing::kFreeRun);
  CAPTURE(capture::to_string(timing));
  FakeRig fake(kLights, 1);
  be_real(fake);
  fake.show_failures = {14};
  Pass pass(fake, olat(timing));
  pass.run();
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
  CHECK_FALSE(fake.any_light_on());
}

TEST_CASE("a dry run stores nothing and says how fast the rig goes", "[timing]") {
  FakeRig fake(kLights, 1);
  be_real(fake);
  std::size_t seen = 0;
  capture::SessionOptions options;
  options.on_frame = [&](const db::Step&, const std::string&, const capture::CameraFrame&) { ++seen; };
  const SessionReport report = capture::dry_run(olat(Timing::kLockstep), fake.rig(), options);
  CHECK(report.stored == seen);
  CHECK(seen == olat(Timing::kLockstep).steps.size());
  CHECK(report.duration > 0);
}

TEST_CASE("a strobe that the controller hears twice costs steps, not truth", "[timing]") {
  const int bounce = GENERATE(20, 30, 40);
  CAPTURE(bounce);
  FakeRig fake(kLights, 1);
  be_real(fake);
  fake.strobe_bounces = {bounce};
  // Tracking frames of another exposure: the slip would end before any of them could betray it.
  capture::OlatOptions options;
  options.light_count = kLights;
  options.tracking_every = 8;
  options.exposure = 8 * kMillisecond;
  Sequence sequence = capture::make_olat_sequence(options);
  sequence.timing = Timing::kPipelined;
  Pass pass(fake, sequence);
  CHECK(pass.run().retaken > 0);
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
}

TEST_CASE("in lockstep a frame that comes after it was given up is not taken for another", "[timing]") {
  const int late_one = GENERATE(10, 20);
  const core::Nanoseconds late = GENERATE(510, 600, 900) * kMillisecond;
  CAPTURE(late_one, late);
  FakeRig fake(kLights, 1);
  be_real(fake);
  fake.delivery = [=](std::size_t, int exposure) {
    Delivery d;
    d.late = exposure == late_one ? late : 12 * kMillisecond;
    d.stamp_late = 8 * kMillisecond + d.late;  // stamped on arrival
    return d;
  };
  Pass pass(fake, olat(Timing::kLockstep));
  pass.run();
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
}

TEST_CASE("a camera that begins to lag for good costs steps, not truth", "[timing]") {
  const Timing timing = GENERATE(Timing::kLockstep, Timing::kPipelined, Timing::kFreeRun);
  const int tracking_every = GENERATE(0, 8);
  // Exposures from which on it lags: some of the pass, by which many precede it in free run.
  const int from = (timing == Timing::kFreeRun ? 230 : 20) + GENERATE(0, 10, 30);
  CAPTURE(capture::to_string(timing), tracking_every, from);
  FakeRig fake(kLights, 1);
  be_real(fake);
  fake.delivery = [=](std::size_t, int exposure) {
    Delivery d;
    d.late = (exposure >= from ? 29 : 12) * kMillisecond;
    d.stamp_late = d.late;
    return d;
  };
  capture::OlatOptions options;
  options.light_count = kLights;
  options.tracking_every = tracking_every;
  options.exposure = 8 * kMillisecond;
  options.full_on_exposure = options.exposure;
  Sequence sequence = capture::make_olat_sequence(options);
  sequence.timing = timing;
  Pass pass(fake, sequence);
  pass.run();
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
}

TEST_CASE("lights whose last tracking frame was not heard are taken again", "[timing]") {
  FakeRig fake(kLights, 1);
  be_real(fake);
  const Sequence sequence = olat(Timing::kPipelined);
  REQUIRE(sequence.steps.back().kind == db::StepKind::kTracking);
  constexpr int kMeasured = 6;  // exposures before the pass
  const int last = kMeasured + static_cast<int>(sequence.steps.size()) - 1;
  fake.delivery = [last, deliver = fake.delivery](std::size_t camera, int exposure) {
    Delivery d = deliver(camera, exposure);
    if (exposure == last) d.copies = 0;
    return d;
  };
  Pass pass(fake, sequence);
  const SessionReport report = pass.run();
  CHECK(report.retaken == 8 + 1);  // those since the tracking frame before it, and itself
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
}

TEST_CASE("single lights taken again in free run are followed by a bright frame", "[timing]") {
  FakeRig fake(kLights, 1);
  be_real(fake);
  fake.delivery = [deliver = fake.delivery](std::size_t camera, int exposure) {
    Delivery d = deliver(camera, exposure);
    if (exposure % 32 < 2) d.copies = 0;
    return d;
  };
  Pass pass(fake, olat(Timing::kFreeRun));
  const SessionReport report = pass.run();
  CAPTURE(fake.exposures(), report.dropped, report.preparation);
  REQUIRE(report.retaken > 0);
  REQUIRE(fake.shown().size() > 2);
  CHECK(fake.shown().back().size() == kLights);
  CHECK(fake.shown()[fake.shown().size() - 2].size() == 1);
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
}

TEST_CASE("exposures longer than the cameras' period slow them down, in every mode", "[timing]") {
  const Timing timing = GENERATE(Timing::kLockstep, Timing::kPipelined, Timing::kFreeRun);
  CAPTURE(capture::to_string(timing));
  FakeRig fake(kLights, 2);
  be_real(fake);
  Sequence sequence = olat(timing, 40 * kMillisecond);
  // Others in between are short, and follow each other as fast as the cameras can.
  for (db::Step& step : sequence.steps) {
    if (step.kind == db::StepKind::kTracking) step.exposure_ns = 3 * kMillisecond;
  }
  Pass pass(fake, sequence);
  const SessionReport report = pass.run();
  CHECK(report.retaken == 0);
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
}

TEST_CASE("cameras that are asked too soon are waited for, in every mode", "[timing]") {
  const Timing timing = GENERATE(Timing::kLockstep, Timing::kPipelined, Timing::kFreeRun);
  CAPTURE(capture::to_string(timing));
  FakeRig fake(kLights, 2);
  be_real(fake);
  fake.least_period = 60 * kMillisecond;
  Pass pass(fake, olat(timing));
  const SessionReport report = pass.run();
  CHECK(report.dropped == 0);
  CHECK(pass.stored() == pass.all());
  CHECK(pass.wrong() == 0);
}
