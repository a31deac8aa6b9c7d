#include "capture/session/camera_feed.h"

#include <catch2/catch.hpp>
#include <random>

#include "fake_rig.h"

using namespace lightstage;
using capture::CameraFeed;
using test::Delivery;
using test::FakeRig;

// The rule by which frames are paired, over far more passes than a store could take in the time.
TEST_CASE("a frame that is handed on was lit by the light that is on") {
  constexpr std::size_t kLights = 9;
  int accepted = 0, refused = 0;
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    std::mt19937_64 random(seed);
    const auto chance = [&](int percent) { return static_cast<int>(random() % 100) < percent; };
    const auto up_to = [&](core::Nanoseconds most) {
      return static_cast<core::Nanoseconds>(random() % static_cast<std::uint64_t>(most + 1));
    };
    FakeRig fake(kLights, 1);
    fake.delivery = [&](std::size_t, int) {
      Delivery d;
      d.copies = static_cast<int>(random() % 4);
      d.damaged = chance(20);
      d.start_delay = up_to(chance(30) ? core::kSecond : core::kMillisecond);
      d.late = up_to(chance(30) ? 2 * core::kSecond : core::kMillisecond);
      return d;
    };
    const capture::Rig rig = fake.rig();
    CameraFeed feed(*rig.cameras[0]);
    std::int64_t last_number = -1;
    for (int step = 0; step < 30; ++step) {
      const std::vector<capture::LightLevel> lit{{static_cast<int>(random() % kLights)}};
      rig.lights.show(lit);
      rig.clock.sleep_until(rig.clock.now() + up_to(3 * core::kMillisecond));
      feed.set_exposure(chance(50) ? 20 * core::kMillisecond : core::kMillisecond);
      feed.flush(rig.clock.now());
      const core::Nanoseconds trigger_time = rig.clock.now();
      rig.trigger->fire();
      const CameraFeed::Result result = feed.receive(trigger_time, trigger_time + 300 * core::kMillisecond);
      if (!result.frame) {
        ++refused;
        continue;
      }
      ++accepted;
      REQUIRE_FALSE(result.damaged);
      REQUIRE_FALSE(result.frame->damaged);
      REQUIRE(result.frame->image(0, 0) == FakeRig::value_for(lit, kLights));
      REQUIRE(result.frame->sequence_number > last_number);
      last_number = result.frame->sequence_number;
    }
  }
  CHECK(accepted > 10000);
  CHECK(refused > 10000);
}

TEST_CASE("a damaged frame of this exposure ends the waiting, an old one does not") {
  FakeRig fake(3, 1);
  fake.delivery = [](std::size_t, int exposure) {
    Delivery d;
    d.damaged = exposure == 0;
    return d;
  };
  const capture::Rig rig = fake.rig();
  CameraFeed feed(*rig.cameras[0]);
  feed.set_exposure(core::kMillisecond);
  rig.clock.sleep_until(core::kSecond);
  rig.trigger->fire();
  const CameraFeed::Result first = feed.receive(core::kSecond, 2 * core::kSecond);
  CHECK(first.damaged);
  CHECK(first.discarded == 1);
  CHECK(rig.clock.now() < 2 * core::kSecond);

  fake.add_stale_frame(0, 5000, core::kSecond / 2, true);
  const core::Nanoseconds trigger_time = rig.clock.now();
  rig.trigger->fire();
  const CameraFeed::Result second = feed.receive(trigger_time, trigger_time + core::kSecond);
  REQUIRE(second.frame);
  CHECK(second.discarded == 1);
}

TEST_CASE("a camera is told its exposure only when that changes") {
  struct CountingCamera : capture::Camera {
    std::string name() const override { return "counting"; }
    void set_exposing(capture::Exposing) override {}
    core::Nanoseconds frame_period() const override { return 0; }
    void set_exposure(core::Nanoseconds) override { ++calls; }
    std::optional<capture::CameraFrame> wait_frame(core::Nanoseconds) override { return std::nullopt; }
    int calls = 0;
  };
  CountingCamera camera;
  CameraFeed feed(camera);
  for (const core::Nanoseconds exposure : {5, 5, 7, 7, 5}) feed.set_exposure(exposure);
  CHECK(camera.calls == 3);
  feed.forget();
  feed.set_exposure(5);
  CHECK(camera.calls == 4);
}
