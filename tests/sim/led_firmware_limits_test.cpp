// The controller against hosts that mean harm: whatever they send, its limits hold at all times.
#include <catch2/catch.hpp>

#include <map>
#include <random>

#include "sim/led_firmware.h"
#include "support/slow_eye.h"  // LightsAt

using namespace lightstage;
using namespace lightstage::capture;
using core::kMillisecond;
using core::kSecond;
using core::Nanoseconds;
using test::LightsAt;

namespace {

constexpr std::uint16_t kOutputs = 8;

// Every limit comes first with some of them.
sim::LedFirmwareOptions limited(std::uint64_t seed) {
  sim::LedFirmwareOptions options;
  options.identity.outputs = kOutputs;
  options.identity.duty_per_mille = seed % 2 == 0 ? 250 : 1000;
  options.identity.duty_window_ms = 400;
  options.identity.on_time_limit_ms = seed % 3 == 0 ? 120 : 5000;
  options.flashing.emplace();
  return options;
}

// Sends what it likes when it likes, and writes down what was lit.
class Host {
 public:
  explicit Host(std::uint64_t seed)
      : random_(seed),
        firmware_(limited(seed), [this](Nanoseconds time, std::span<const OutputLevel> lit) { note(time, lit); }) {
    changes_.emplace_back(0, std::vector<double>(kOutputs, 0.0));
  }

  void run(int commands) {
    // Some hosts hurry, some are slow; some flash everything, some anything.
    const double pace_ms = std::exp(draw(std::log(0.3), std::log(120.0)));
    const int strobing = int(random_() % 3);
    for (int i = 0; i < commands; ++i) {
      now_ += Nanoseconds(draw(0.1, 2) * pace_ms * 1e6);
      if (random_() % 200 == 0) now_ += kSecond * Nanoseconds(random_() % 3);
      const unsigned what = unsigned(random_() % 20);
      if (strobing > 0 && what < 14) {
        send(i % 2 == 0 ? LedMessage(Show{everything(strobing == 1 ? 65535 : std::uint16_t(random_()))})
                        : LedMessage(Off{}));
      } else {
        act(what);
      }
      if (random_() % 3 == 0) firmware_.tick(now_);
      // What has gone wrong is no hindrance: it says OFF and goes on.
      if (firmware_.faults() != 0 && random_() % 2 == 0) send(Off{});
      firmware_.take_output();
    }
    now_ += 2 * kSecond;
    firmware_.tick(now_);
  }

  const std::vector<LightsAt>& changes() const { return changes_; }
  const std::vector<Nanoseconds>& heard() const { return heard_; }
  Nanoseconds end() const { return now_; }
  const std::map<std::uint32_t, int>& faults() const { return faults_; }

 private:
  double draw(double least, double most) { return std::uniform_real_distribution<double>(least, most)(random_); }

  static OutputPattern everything(std::uint16_t level) {
    OutputPattern pattern;
    for (std::uint16_t i = 0; i < kOutputs; ++i) pattern.push_back({i, level, level, level});
    return pattern;
  }
  OutputPattern anything() {
    OutputPattern pattern;
    for (std::uint16_t i = 0; i < kOutputs; ++i) {
      if (random_() % 2 == 0)
        pattern.push_back({i, std::uint16_t(random_()), std::uint16_t(random_()), std::uint16_t(random_())});
    }
    return pattern;
  }

  void act(unsigned what) {
    if (what < 5) return send(Show{random_() % 2 == 0 ? everything(65535) : anything()});
    if (what < 7)
      return send(Arm{std::uint32_t(random_() % 4), StepSource(random_() % 2), StrobeEdge(random_() % 2),
                      std::uint16_t(random_() % 3000)});
    if (what < 9) return send(StepOn{});
    if (what < 11) return firmware_.strobe_edge(random_() % 2 == 0, now_);
    if (what == 11) return send(Off{});
    if (what == 12) return send(Identify{});
    if (what == 13) return send(AskStatus{});
    if (what == 14) {
      std::vector<OutputPattern> patterns;
      for (unsigned i = 0; i < 1 + random_() % 6; ++i)
        patterns.push_back(random_() % 3 == 0 ? OutputPattern{} : anything());
      const std::vector<std::uint8_t> bytes = encode_patterns(patterns);
      return send(Load{std::uint32_t(patterns.size()), std::uint32_t(bytes.size()), crc32c(bytes), 0, bytes});
    }
    if (what == 15) {
      firmware_.disconnect(now_);
      return;
    }
    if (what == 16) {
      std::vector<std::uint8_t> garbage(random_() % 50);
      for (std::uint8_t& byte : garbage) byte = std::uint8_t(random_());
      return firmware_.receive(garbage, now_);
    }
    send(KeepAlive{});
  }

  void send(const LedMessage& message) {
    // Now and then an old number, which must not be carried out.
    if (random_() % 20 != 0) ++sequence_;
    firmware_.receive(encode(message, sequence_), now_);
    heard_.push_back(now_);
  }

  void note(Nanoseconds time, std::span<const OutputLevel> lit) {
    REQUIRE(time >= changes_.back().time);
    LightsAt change{time, std::vector<double>(kOutputs, 0.0)};
    for (const OutputLevel& l : lit) change.levels[l.output] = {l.r / 65535.0, l.g / 65535.0, l.b / 65535.0};
    changes_.push_back(std::move(change));
    for (std::uint32_t bit = 0; lit.empty() && bit < 8; ++bit) faults_[1u << bit] += (firmware_.faults() >> bit) & 1u;
  }

  std::mt19937_64 random_;
  std::vector<LightsAt> changes_;
  std::vector<Nanoseconds> heard_;
  std::map<std::uint32_t, int> faults_;
  sim::LedFirmware firmware_;
  Nanoseconds now_ = 0;
  std::uint32_t sequence_ = 0;
};

bool is_dark(const test::Colour& colour) {
  return colour == test::Colour{};
}

// When the output was on.
std::vector<std::pair<Nanoseconds, Nanoseconds>> on_times(const Host& host, std::size_t output) {
  std::vector<std::pair<Nanoseconds, Nanoseconds>> times;
  for (std::size_t i = 0; i < host.changes().size(); ++i) {
    if (is_dark(host.changes()[i].levels[output])) continue;
    const Nanoseconds begin = host.changes()[i].time,
                      end = i + 1 < host.changes().size() ? host.changes()[i + 1].time : host.end();
    if (!times.empty() && times.back().second == begin) {
      times.back().second = end;
    } else {
      times.emplace_back(begin, end);
    }
  }
  return times;
}

}  // namespace

TEST_CASE("no host makes a controller exceed its limits of heat, flashing and silence", "[led-firmware]") {
  std::map<std::uint32_t, int> faults;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    CAPTURE(seed);
    const sim::LedFirmwareOptions limits = limited(seed);
    Host host(seed);
    host.run(600);
    for (const auto& [fault, count] : host.faults()) faults[fault] += count;
    const double duty = limits.identity.duty_per_mille / 1000.0, window_s = limits.identity.duty_window_ms / 1000.0;
    for (std::size_t output = 0; output < kOutputs; ++output) {
      const auto times = on_times(host, output);
      for (std::size_t i = 0; i < times.size(); ++i) {
        REQUIRE(times[i].second - times[i].first <= limits.identity.on_time_limit_ms * kMillisecond);
        double on_s = 0;
        for (std::size_t j = i; j < times.size(); ++j) {
          on_s += double(times[j].second - times[j].first) / 1e9;
          REQUIRE(on_s <= duty * (double(times[j].second - times[i].first) / 1e9 + window_s) + 1e-6);
        }
      }
    }
    // Lit only while the host was heard of in the last 500 ms.
    for (std::size_t i = 0; i < host.changes().size(); ++i) {
      const LightsAt& change = host.changes()[i];
      if (std::all_of(change.levels.begin(), change.levels.end(), is_dark)) continue;
      const Nanoseconds off = i + 1 < host.changes().size() ? host.changes()[i + 1].time : host.end();
      const auto after = std::lower_bound(host.heard().begin(), host.heard().end(), off);
      REQUIRE(after != host.heard().begin());
      REQUIRE(off - *std::prev(after) <= kHostSilenceLimit);
    }
    // The lights never stay as they are for longer than an onlooker stands it.
    FlashMeter onlooker(kOutputs, *limits.flashing);
    for (std::size_t i = 0; i < host.changes().size(); ++i) {
      std::vector<LitLight> lit;
      for (std::size_t l = 0; l < kOutputs; ++l) lit.push_back({l, host.changes()[i].levels[l]});
      onlooker.show(host.changes()[i].time, lit);
      const auto too_many = onlooker.too_many();
      REQUIRE((!too_many || *too_many >= (i + 1 < host.changes().size() ? host.changes()[i + 1].time : host.end())));
    }
    REQUIRE(onlooker.worst().in_a_second <= 4);  // the fourth is cut off as it begins
    REQUIRE(onlooker.worst_small().in_a_second <= 10);
  }
  // They did try.
  for (const std::uint32_t fault : {kFaultHostSilent, kFaultOnTime, kFaultDuty, kFaultFlashing}) {
    CAPTURE(fault);
    CHECK(faults[fault] > 5);
  }
}

TEST_CASE("a controller lets no colour flash by itself that it would not let flash in white", "[led-firmware]") {
  for (int colour = 0; colour < 3; ++colour) {
    sim::LedFirmwareOptions options;
    options.identity.outputs = kOutputs;
    options.identity.duty_per_mille = 1000;
    options.flashing.emplace();
    sim::LedFirmware firmware(options, [](Nanoseconds, std::span<const OutputLevel>) {});
    OutputPattern one, another;
    for (std::uint16_t i = 0; i < kOutputs; ++i) {
      const auto level = [&](int c) { return std::uint16_t(c % 3 == colour ? 65535 : 0); };
      one.push_back({i, level(0), level(1), level(2)});
      another.push_back({i, level(1), level(2), level(0)});
    }
    std::uint32_t sequence = 0;
    for (int i = 0; i < 20 && firmware.faults() == 0; ++i) {
      firmware.receive(encode(Show{i % 2 == 0 ? one : another}, ++sequence), i * 40 * kMillisecond);
    }
    CHECK(firmware.faults() == kFaultFlashing);
  }
}

TEST_CASE("a controller that flashed too often goes dark at that moment, and remembers what it showed",
          "[led-firmware]") {
  sim::LedFirmwareOptions options;
  options.identity.outputs = kOutputs;
  options.identity.duty_per_mille = 1000;
  options.flashing.emplace();
  Nanoseconds last_dark = 0;
  sim::LedFirmware firmware(options, [&](Nanoseconds time, std::span<const OutputLevel> lit) {
    if (lit.empty()) last_dark = time;
  });
  OutputPattern full;
  for (std::uint16_t i = 0; i < kOutputs; ++i) full.push_back({i, 65535, 65535, 65535});
  std::uint32_t sequence = 0;
  const auto send = [&](const LedMessage& message, Nanoseconds now) {
    firmware.receive(encode(message, ++sequence), now);
  };
  for (int i = 0; i < 4; ++i) {
    send(Show{full}, i * 200 * kMillisecond);
    CHECK(firmware.faults() == 0);
    firmware.tick(i * 200 * kMillisecond + 100 * kMillisecond - 1);
    if (i < 3) send(Off{}, i * 200 * kMillisecond + 100 * kMillisecond);
  }
  // A tenth of full light is reached 4 to 5 ms after the fourth went on.
  CHECK(firmware.faults() == kFaultFlashing);
  CHECK(last_dark > 604 * kMillisecond);
  CHECK(last_dark < 606 * kMillisecond);
  // Clearing the fault does not clear the memory.
  Nanoseconds now = 710 * kMillisecond;
  for (const LedMessage& excuse : {LedMessage(Off{}), LedMessage(Identify{})}) {
    send(excuse, now);
    CHECK(firmware.faults() == 0);
    send(Show{full}, now + 10 * kMillisecond);
    firmware.tick(now + 20 * kMillisecond);
    CHECK(firmware.faults() == kFaultFlashing);
    now += 100 * kMillisecond;
  }
  // A second later it may flash again.
  send(Off{}, 1800 * kMillisecond);
  send(Show{full}, 1800 * kMillisecond);
  firmware.tick(2 * kSecond);
  CHECK(firmware.faults() == 0);
  CHECK(firmware.lit() == full);
}
