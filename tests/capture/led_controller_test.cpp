#include <atomic>
#include <catch2/catch.hpp>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <set>
#include <utility>

#include "capture/protocol_leds.h"
#include "core/error.h"
#include "sim/firmware_link.h"
#include "sim/led_firmware.h"

using namespace lightstage;
using namespace lightstage::capture;
using core::kMillisecond;
using core::kSecond;
using core::Nanoseconds;

namespace {

using Bytes = std::vector<std::uint8_t>;

enum class Fault {
  kNone,
  kLost,        // the answer never comes
  kLate,        // it comes only after the host has asked again
  kDuplicated,  // it comes twice
  kCorrupted,   // a bit of it is flipped
  kTruncated,   // its end is missing
  kMute,        // neither does the message arrive
  kDamagedCommand,
  kUnplugged,  // at this very write; stays so until plugged in again
};

// A cable that spoils what travels, by the number of the write that it befalls.
class FaultyLink : public LedLink {
 public:
  FaultyLink(sim::LedFirmware& firmware, core::Clock& clock)
      : inner(firmware, clock), firmware_(firmware), clock_(clock) {}

  void write(std::span<const std::uint8_t> bytes, Nanoseconds deadline) override {
    if (!plugged) gone();
    const auto found = faults.find(writes++);
    fault_ = found == faults.end() ? Fault::kNone : found->second;
    if (fault_ == Fault::kUnplugged) unplug();
    if (fault_ == Fault::kMute) return;
    Bytes sent(bytes.begin(), bytes.end());
    if (fault_ == Fault::kDamagedCommand) sent[sent.size() / 2] ^= 0x10;
    inner.write(sent, deadline);
  }

  Bytes read(Nanoseconds deadline) override {
    if (!plugged) gone();
    Bytes bytes = std::exchange(late_, {});
    if (bytes.empty()) bytes = inner.read(deadline);
    if (bytes.empty()) return bytes;
    switch (std::exchange(fault_, Fault::kNone)) {
      case Fault::kLost:
        bytes.clear();
        break;
      case Fault::kLate:
        late_ = std::exchange(bytes, {});
        break;
      case Fault::kDuplicated:
        bytes.insert(bytes.end(), bytes.begin(), bytes.end());
        break;
      case Fault::kCorrupted:
        bytes[bytes.size() - 3] ^= 0x40;
        break;
      case Fault::kTruncated:
        bytes.resize(bytes.size() / 2);
        break;
      default:
        break;
    }
    if (bytes.empty()) clock_.sleep_until(deadline);
    return bytes;
  }

  [[noreturn]] void unplug() {
    plugged = false;
    firmware_.disconnect(clock_.now());
    late_.clear();
    gone();
  }
  [[noreturn]] static void gone() { throw core::DeviceError("LED controller: unplugged"); }

  sim::FirmwareLink inner;
  std::map<int, Fault> faults;
  int writes = 0;
  bool plugged = true;

 private:
  sim::LedFirmware& firmware_;
  core::Clock& clock_;
  Fault fault_ = Fault::kNone;
  Bytes late_;
};

struct Change {
  Nanoseconds time = 0;
  OutputPattern lit;
};

sim::LedFirmwareOptions without_limits() {
  sim::LedFirmwareOptions options;
  options.identity.outputs = 16;
  options.identity.on_time_limit_ms = 0;
  options.identity.duty_per_mille = 1000;
  options.identity.max_payload = 200;  // sequences travel in many parts
  return options;
}

struct Rig {
  explicit Rig(sim::LedFirmwareOptions options = without_limits(), std::vector<int> outputs = {4, 2, 7})
      : firmware(std::move(options), [this](Nanoseconds time, std::span<const OutputLevel> lit) {
          changes.push_back({time, {lit.begin(), lit.end()}});
        }) {
    auto owned = std::make_unique<FaultyLink>(firmware, clock);
    link = owned.get();
    leds = std::make_unique<ProtocolLeds>(std::move(owned), ProtocolLedsOptions{"LED controller 'A'", outputs, false},
                                          clock);
  }
  // The fault befalls the n-th write from now.
  void fault(int n, Fault what) { link->faults[link->writes + n] = what; }
  void strobe(Nanoseconds after) {
    link->inner.schedule_strobe(true, clock.now() + after - 1000);
    link->inner.schedule_strobe(false, clock.now() + after);
  }

  core::VirtualClock clock;
  std::vector<Change> changes;
  sim::LedFirmware firmware;
  FaultyLink* link = nullptr;
  std::unique_ptr<ProtocolLeds> leds;
};

const std::vector<LightLevel> kFirst{{0, 1, 0.5F, 0}}, kOthers{{2, 0, 0, 1}, {1, 1, 1, 1}};
const OutputPattern kFirstOutputs{{4, 65535, 32768, 0}}, kOtherOutputs{{2, 65535, 65535, 65535}, {7, 0, 0, 65535}};

template <class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const core::DeviceError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("lights are shown at their outputs, as they were asked, and turned off", "[protocol-leds]") {
  Rig rig;
  CHECK(rig.leds->light_count() == 3);
  CHECK(rig.leds->identity().serial == "SIM0001");
  rig.leds->show(kFirst);
  CHECK(rig.firmware.lit() == kFirstOutputs);
  rig.leds->show(kOthers);
  CHECK(rig.firmware.lit() == kOtherOutputs);
  rig.leds->all_off();
  CHECK(rig.firmware.lit().empty());
  rig.leds->show(kFirst);
  rig.leds.reset();
  CHECK(rig.firmware.lit().empty());
}

TEST_CASE("a controller that does not suit the stage is turned away", "[protocol-leds]") {
  CHECK_THROWS_AS(Rig(without_limits(), {1, 2, 1}), core::UsageError);
  CHECK_THROWS_AS(Rig(without_limits(), {1, -2}), core::UsageError);
  CHECK_THROWS_AS(Rig(without_limits(), {1, 16}), core::DeviceError);
  sim::LedFirmwareOptions other = without_limits();
  other.identity.protocol = 2;
  CHECK_THROWS_AS(Rig(other), core::DeviceError);
  other = without_limits();
  other.identity.max_payload = 131;  // of 132 that a SHOW of all outputs has
  CHECK_THROWS_AS(Rig(other), core::DeviceError);
}

TEST_CASE("a level outside 0 to 1 or a light that is not there lights nothing", "[protocol-leds]") {
  const std::vector<LightLevel> bad =
      GENERATE(std::vector<LightLevel>{{3}}, std::vector<LightLevel>{{-1}}, std::vector<LightLevel>{{0, 1.01F, 0, 0}},
               std::vector<LightLevel>{{0, -0.01F, 0, 0}}, std::vector<LightLevel>{{0, NAN, 0, 0}},
               std::vector<LightLevel>{{1}, {1}});
  Rig rig;
  CHECK_THROWS_AS(rig.leds->show(bad), core::DeviceError);
  CHECK(rig.changes.empty());
}

TEST_CASE("one lost, late, doubled or damaged answer is made good without anybody noticing", "[protocol-leds]") {
  const Fault fault = GENERATE(Fault::kLost, Fault::kLate, Fault::kDuplicated, Fault::kCorrupted, Fault::kTruncated,
                               Fault::kMute, Fault::kDamagedCommand);
  const int at = GENERATE(0, 1, 2, 3);
  INFO("fault " << int(fault) << " at write " << at);
  Rig rig;
  rig.fault(at, fault);
  rig.leds->show(kFirst);
  CHECK(rig.firmware.lit() == kFirstOutputs);
  CHECK(rig.leds->status().faults.empty());
  rig.leds->show(kOthers);
  CHECK(rig.firmware.lit() == kOtherOutputs);
  rig.leds->all_off();
  CHECK(rig.firmware.lit().empty());
  CHECK(rig.changes.size() == 3);  // each was carried out once
}

TEST_CASE("a controller that stays mute is given up after 400 ms, and is dark 500 ms after it last heard",
          "[protocol-leds]") {
  Rig rig;
  rig.leds->show(kFirst);
  const Nanoseconds shown = rig.clock.now();
  rig.clock.sleep_until(shown + 90 * kMillisecond);
  for (int i = 0; i < 4; ++i) rig.fault(i, Fault::kMute);
  const std::string error = error_of([&] { rig.leds->show(kOthers); });
  CHECK(error.find("LED controller 'A': no answer to SHOW (asked 4 times)") == 0);
  CHECK(rig.clock.now() == shown + 490 * kMillisecond);
  rig.firmware.tick(shown + kSecond);
  CHECK(rig.changes.back().time == shown + kHostSilenceLimit);
  CHECK(rig.changes.back().lit.empty());
  CHECK(rig.changes.size() == 2);

  // Once it hears again, it is asked who it is, which clears the fault.
  rig.clock.sleep_until(shown + kSecond);
  rig.leds->show(kOthers);
  CHECK(rig.firmware.lit() == kOtherOutputs);
  CHECK(rig.leds->status().faults.empty());
}

TEST_CASE("an answer that comes only for the fourth try is an answer", "[protocol-leds]") {
  Rig rig;
  for (int i = 0; i < 3; ++i) rig.fault(i, i % 2 ? Fault::kMute : Fault::kLost);
  rig.leds->show(kFirst);
  CHECK(rig.firmware.lit() == kFirstOutputs);
  CHECK(rig.changes.size() == 1);
}

TEST_CASE("after an unplug the next call finds a dark controller and goes on", "[protocol-leds]") {
  Rig rig;
  rig.leds->show(kFirst);
  rig.fault(0, Fault::kUnplugged);
  CHECK_THROWS_AS(rig.leds->show(kOthers), core::DeviceError);
  CHECK(rig.firmware.lit().empty());
  CHECK_THROWS_AS(rig.leds->show(kOthers), core::DeviceError);
  CHECK_THROWS_AS(rig.leds->all_off(), core::DeviceError);
  rig.link->plugged = true;
  rig.leds->show(kOthers);
  CHECK(rig.firmware.lit() == kOtherOutputs);
  rig.leds->all_off();
  CHECK(rig.firmware.lit().empty());
}

TEST_CASE("lights that the controller turned off by itself are reported, once", "[protocol-leds]") {
  sim::LedFirmwareOptions options = without_limits();
  options.identity.on_time_limit_ms = 300;
  Rig rig(options);
  rig.leds->show(kFirst);
  rig.clock.sleep_until(rig.clock.now() + 350 * kMillisecond);

  SECTION("to who asks for the status") {
    CHECK(rig.leds->status().faults == std::vector<std::string>{"an output was on for longer than its limit"});
    CHECK_THROWS_AS(rig.leds->show(kFirst), core::DeviceError);
  }
  SECTION("to who wants to go on") {
    const std::string error = error_of([&] { rig.leds->show(kFirst); });
    CHECK(error.find("an output was on for longer than its limit") != std::string::npos);
  }
  rig.leds->show(kFirst);
  CHECK(rig.firmware.lit() == kFirstOutputs);
  CHECK(rig.leds->status().faults.empty());
}

TEST_CASE("a light that must rest is refused by name, and the others go on", "[protocol-leds]") {
  sim::LedFirmwareOptions options = without_limits();
  options.identity.duty_per_mille = 100;
  options.identity.duty_window_ms = 1000;
  Rig rig(options);
  rig.leds->show(kFirst);
  rig.clock.sleep_until(rig.clock.now() + 200 * kMillisecond);
  CHECK_THROWS_AS(rig.leds->show(kFirst), core::DeviceError);
  const std::string error = error_of([&] { rig.leds->show(kFirst); });
  CHECK(error.find("output 4 was on for too much of the time") != std::string::npos);
  CHECK(rig.firmware.lit().empty());
  rig.leds->show(kOthers);
  CHECK(rig.firmware.lit() == kOtherOutputs);
}

TEST_CASE("the status is in degrees and volts", "[protocol-leds]") {
  Rig rig;
  CHECK_FALSE(rig.leds->status().temperature_celsius);
  CHECK_FALSE(rig.leds->status().supply_volts);
  rig.firmware.set_temperature(41.2, 0);
  rig.firmware.set_supply_volts(23.95);
  CHECK(rig.leds->status().temperature_celsius == Approx(41.2));
  CHECK(rig.leds->status().supply_volts == Approx(23.95));
  CHECK(describe_faults(kFaultTemperature | 1u << 30) ==
        std::vector<std::string>{"too hot: let it cool down", "fault 30: see the controller's manual"});
}

namespace {

std::vector<std::vector<LightLevel>> one_after_the_other(int count) {
  std::vector<std::vector<LightLevel>> patterns;
  for (int i = 0; i < count; ++i) patterns.push_back({{i % 3, 1, float(i) / float(count), 0}});
  return patterns;
}

}  // namespace

TEST_CASE("a sequence is played by strobes, and each pattern is waited for", "[protocol-leds]") {
  sim::LedFirmwareOptions options = without_limits();
  options.host_silence_limit = 3600 * kSecond;  // nothing is sent while virtual time passes
  Rig rig(options);
  PatternPlayer* player = rig.leds->player();
  REQUIRE(player != nullptr);
  player->load(one_after_the_other(100));  // 1200 bytes, in 7 parts
  CHECK(rig.changes.empty());
  player->arm(2, 0);
  CHECK(rig.firmware.lit().at(0).output == 7);
  CHECK(player->wait_for_pattern(2, rig.clock.now()) == rig.clock.now());
  for (std::size_t i = 3; i <= 100; ++i) {
    rig.strobe(7 * kMillisecond);
    const Nanoseconds begin = rig.clock.now();
    const auto time = player->wait_for_pattern(i, begin + 50 * kMillisecond);
    REQUIRE(time);
    CHECK(*time >= rig.changes.back().time);
    CHECK(*time == begin + 7 * kMillisecond);
    CHECK(rig.firmware.lit().size() == (i < 100 ? 1 : 0));
  }
  CHECK_FALSE(player->wait_for_pattern(101, rig.clock.now() + kMillisecond));
  rig.leds->show(kFirst);
  CHECK_THROWS_AS(player->wait_for_pattern(3, rig.clock.now() + kMillisecond), core::DeviceError);
}

TEST_CASE("a step that does not come is waited for until the deadline", "[protocol-leds]") {
  Rig rig;
  rig.leds->load(one_after_the_other(5));
  rig.leds->arm(0, 0);
  const Nanoseconds deadline = rig.clock.now() + 20 * kMillisecond;
  CHECK_FALSE(rig.leds->wait_for_pattern(1, deadline));
  CHECK(rig.clock.now() == deadline);
}

TEST_CASE("a lost event costs time, not a step", "[protocol-leds]") {
  Rig rig;
  rig.leds->load(one_after_the_other(5));
  rig.leds->arm(0, 0);
  rig.strobe(5 * kMillisecond);
  rig.clock.sleep_until(rig.clock.now() + 5 * kMillisecond);
  rig.link->inner.catch_up();
  REQUIRE(!rig.firmware.take_output().empty());  // lost on its way
  const Nanoseconds deadline = rig.clock.now() + 20 * kMillisecond;
  CHECK(rig.leds->wait_for_pattern(1, deadline) == deadline);
  // When the controller is beyond it already, it is not lit any more.
  rig.strobe(5 * kMillisecond);
  rig.strobe(6 * kMillisecond);
  rig.clock.sleep_until(rig.clock.now() + 5 * kMillisecond);
  rig.link->inner.catch_up();
  rig.firmware.take_output();
  CHECK_FALSE(rig.leds->wait_for_pattern(2, rig.clock.now() + 20 * kMillisecond));
  CHECK(rig.leds->wait_for_pattern(3, rig.clock.now()));
}

TEST_CASE("events of what was armed before are not taken for those of now", "[protocol-leds]") {
  Rig rig;
  rig.leds->load(one_after_the_other(5));
  rig.leds->arm(0, 0);
  rig.strobe(kMillisecond);
  rig.clock.sleep_until(rig.clock.now() + kMillisecond);
  rig.leds->arm(0, 0);
  CHECK_FALSE(rig.leds->wait_for_pattern(1, rig.clock.now() + kMillisecond));
}

TEST_CASE("a sequence is loaded again where it was lost with the controller", "[protocol-leds]") {
  Rig rig;
  rig.leds->load(one_after_the_other(60));
  rig.leds->arm(0, 0);
  rig.fault(0, Fault::kUnplugged);
  CHECK_THROWS_AS(rig.leds->show(kFirst), core::DeviceError);
  rig.link->plugged = true;
  rig.leds->arm(59, 0);
  CHECK(rig.firmware.lit().at(0).output == 7);

  // In the midst of loading, too.
  rig.fault(3, Fault::kUnplugged);
  CHECK_THROWS_AS(rig.leds->load(one_after_the_other(61)), core::DeviceError);
  CHECK(rig.firmware.lit().empty());
  rig.link->plugged = true;
  rig.leds->arm(60, 0);
  CHECK(rig.firmware.lit().at(0).output == 4);
}

TEST_CASE("a sequence that the controller cannot hold is refused before anything is sent", "[protocol-leds]") {
  sim::LedFirmwareOptions options = without_limits();
  options.identity.max_patterns = 4;
  options.identity.max_sequence_bytes = 100;
  Rig rig(options);
  const int before = rig.link->writes;
  CHECK_THROWS_AS(rig.leds->load(one_after_the_other(5)), core::DeviceError);
  CHECK_THROWS_AS(rig.leds->load(std::vector<std::vector<LightLevel>>(4, {{0}, {1}, {2}})), core::DeviceError);
  CHECK_THROWS_AS(rig.leds->load({}), core::DeviceError);
  CHECK(rig.link->writes == before);
  options.identity.max_patterns = 0;
  CHECK(Rig(options).leds->player() == nullptr);
}

TEST_CASE("whatever befalls the cable: no pattern is half shown, and after an error it gets dark", "[protocol-leds]") {
  std::mt19937_64 random(11);
  int errors = 0, shows = 0;
  for (int round = 0; round < 200; ++round) {
    sim::LedFirmwareOptions options = without_limits();
    options.identity.outputs = 16;
    Rig rig(options, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9});
    for (int i = 0; i < 60; ++i) {
      if (random() % 100 < 50) rig.fault(i, static_cast<Fault>(1 + random() % 8));
    }
    std::set<std::vector<std::uint16_t>> asked{{}};  // lit outputs
    for (int step = 0; step < 6; ++step) {
      std::vector<LightLevel> levels;
      std::vector<std::uint16_t> outputs;
      for (int light = 0; light < 10; ++light) {
        if (random() % 2 == 0) continue;
        levels.push_back({light, 1, 1, 1});
        outputs.push_back(static_cast<std::uint16_t>(light));
      }
      asked.insert(outputs);
      const auto lit = [&] {
        std::vector<std::uint16_t> on;
        for (const OutputLevel& level : rig.firmware.lit()) on.push_back(level.output);
        return on;
      };
      try {
        ++shows;
        rig.leds->show(levels);
        REQUIRE(lit() == outputs);
      } catch (const core::DeviceError&) {
        ++errors;
        const Nanoseconds failed = rig.clock.now();
        if (random() % 2 == 0) {  // the host does nothing more
          rig.clock.sleep_until(failed + kHostSilenceLimit);
          rig.firmware.tick(rig.clock.now());
          REQUIRE(lit().empty());
        } else {  // the link works again
          rig.link->faults.clear();
          rig.link->plugged = true;
          rig.leds->all_off();
          REQUIRE(lit().empty());
        }
        rig.link->plugged = true;
      }
    }
    for (const Change& change : rig.changes) {
      std::vector<std::uint16_t> on;
      for (const OutputLevel& level : change.lit) on.push_back(level.output);
      REQUIRE(asked.contains(on));
    }
  }
  CHECK(errors > 50);
  CHECK(errors < shows);
}

namespace {

// A controller beside a thread that keeps it alive, in real time.
class SharedLink : public LedLink {
 public:
  SharedLink(sim::LedFirmware& firmware, core::Clock& clock, std::mutex& mutex)
      : firmware_(firmware), clock_(clock), mutex_(mutex) {}
  void write(std::span<const std::uint8_t> bytes, Nanoseconds) override {
    const std::lock_guard lock(mutex_);
    if (gone) throw core::DeviceError("LED controller: unplugged");
    firmware_.receive(bytes, clock_.now());
  }
  Bytes read(Nanoseconds deadline) override {
    while (true) {
      {
        const std::lock_guard lock(mutex_);
        firmware_.tick(clock_.now());
        Bytes bytes = firmware_.take_output();
        if (!bytes.empty() || clock_.now() >= deadline) return bytes;
      }
      clock_.sleep_until(std::min(deadline, clock_.now() + kMillisecond));
    }
  }
  std::atomic<bool> gone = false;

 private:
  sim::LedFirmware& firmware_;
  core::Clock& clock_;
  std::mutex& mutex_;
};

}  // namespace

TEST_CASE("while the host lives, the lights stay on; when it is stuck, they do not", "[protocol-leds]") {
  core::SystemClock clock;
  std::mutex mutex;
  std::vector<Change> changes;
  sim::LedFirmware firmware(without_limits(), [&](Nanoseconds time, std::span<const OutputLevel> lit) {
    changes.push_back({time, {lit.begin(), lit.end()}});
  });
  auto owned = std::make_unique<SharedLink>(firmware, clock, mutex);
  SharedLink* link = owned.get();
  ProtocolLeds leds(std::move(owned), {"LED controller", {0, 1, 2}, true}, clock);
  const auto settle = [&](Nanoseconds time) {
    clock.sleep_until(clock.now() + time);
    const std::lock_guard lock(mutex);
    firmware.tick(clock.now());
    return changes.size();
  };
  leds.show(kFirst);
  CHECK(settle(1200 * kMillisecond) == 1);

  // While a pattern is waited for as well.
  leds.load(one_after_the_other(3));
  leds.arm(0, 0);
  CHECK_FALSE(leds.wait_for_pattern(1, clock.now() + 700 * kMillisecond));
  CHECK(firmware.faults() == 0);

  link->gone = true;
  settle(700 * kMillisecond);
  CHECK(changes.back().lit.empty());
  link->gone = false;
  CHECK_THROWS_AS(leds.status(), core::DeviceError);  // what the thread has seen
  leds.show(kFirst);
  CHECK(firmware.lit().size() == 1);
  leds.all_off();
}
