#include "sim/led_firmware.h"

#include <catch2/catch.hpp>

using namespace lightstage;
using namespace lightstage::capture;
using core::kMillisecond;
using core::kSecond;
using core::Nanoseconds;

namespace {

struct Change {
  Nanoseconds time = 0;
  OutputPattern lit;
  friend bool operator==(const Change&, const Change&) = default;
};

const OutputPattern kRed{{3, 65535, 0, 0}}, kGreen{{4, 0, 65535, 0}}, kTwo{{0, 1, 0, 0}, {5, 0, 0, 9}};

sim::LedFirmwareOptions unlimited() {
  sim::LedFirmwareOptions options;
  options.identity.outputs = 8;
  options.identity.on_time_limit_ms = 0;
  options.identity.duty_per_mille = 1000;
  return options;
}

// A controller and the host's end of its cable.
class Bench {
 public:
  explicit Bench(sim::LedFirmwareOptions options = unlimited())
      : firmware(std::move(options), [this](Nanoseconds time, std::span<const OutputLevel> lit) {
          changes.push_back({time, {lit.begin(), lit.end()}});
        }) {}

  // The single answer.
  LedMessage ask(const LedMessage& command, Nanoseconds now) { return ask_as(++sequence, command, now); }
  LedMessage ask_as(std::uint32_t number, const LedMessage& command, Nanoseconds now) {
    firmware.receive(encode(command, number), now);
    std::vector<LedMessage> answers;
    for (const auto& [answer_sequence, message] : received()) {
      if (answer_sequence == number) answers.push_back(message);
    }
    REQUIRE(answers.size() == 1);
    return answers[0];
  }
  bool obeys(const LedMessage& command, Nanoseconds now) { return std::holds_alternative<Ack>(ask(command, now)); }
  std::optional<NakReason> refusal(const LedMessage& command, Nanoseconds now) {
    const LedMessage answer = ask(command, now);
    const auto* nak = std::get_if<Nak>(&answer);
    return nak ? std::optional(nak->reason) : std::nullopt;
  }
  StatusReport status(Nanoseconds now) { return std::get<StatusReport>(ask(AskStatus{}, now)); }
  void load(const std::vector<OutputPattern>& patterns, Nanoseconds now) {
    const auto bytes = encode_patterns(patterns);
    const auto count = static_cast<std::uint32_t>(patterns.size());
    REQUIRE(obeys(Load{count, static_cast<std::uint32_t>(bytes.size()), crc32c(bytes), 0, bytes}, now));
  }
  void keep_alive_until(Nanoseconds from, Nanoseconds to) {
    for (Nanoseconds t = from; t <= to; t += 100 * kMillisecond) obeys(KeepAlive{}, t);
  }

  std::vector<std::pair<std::uint32_t, LedMessage>> received() {
    MessageReader reader;
    reader.feed(firmware.take_output());
    std::vector<std::pair<std::uint32_t, LedMessage>> messages;
    while (const std::optional<LedFrame> frame = reader.next()) messages.emplace_back(frame->sequence, *decode(*frame));
    return messages;
  }

  std::vector<Change> changes;
  sim::LedFirmware firmware;
  std::uint32_t sequence = 0;
};

}  // namespace

TEST_CASE("a controller says who it is, lights what is shown and nothing else", "[led-firmware]") {
  Bench bench;
  CHECK(std::get<Identity>(bench.ask(Identify{}, 0)) == unlimited().identity);
  const Ack ack = std::get<Ack>(bench.ask(Show{kTwo}, 5));
  CHECK(ack == Ack{LedMessageType::kShow, LedState::kShowing, 2, kNoPosition, 0});
  CHECK(bench.firmware.lit() == kTwo);
  bench.ask(Show{kRed}, 7);
  bench.ask(Show{{{2, 0, 0, 0}}}, 9);  // an output at zero is off
  CHECK(bench.changes == std::vector<Change>{{5, kTwo}, {7, kRed}, {9, {}}});
  CHECK(bench.refusal(Show{{{1, 1, 1, 1}, {8, 1, 1, 1}}}, 11) == NakReason::kBadOutput);
  CHECK(bench.changes.size() == 3);
}

TEST_CASE("the lights go out when the host has been silent for 500 ms, at that very moment", "[led-firmware]") {
  Bench bench;
  const Nanoseconds shown = 10 * kMillisecond;
  bench.ask(Show{kRed}, shown);
  CHECK(bench.firmware.next_event() == shown + kHostSilenceLimit);

  SECTION("a message just in time keeps them on") {
    bench.ask(KeepAlive{}, shown + 500 * kMillisecond - 1);
    CHECK(bench.firmware.lit() == kRed);
    bench.firmware.tick(shown + 1000 * kMillisecond - 2);
    CHECK(bench.firmware.lit() == kRed);
    bench.firmware.tick(shown + 1000 * kMillisecond - 1);
    CHECK(bench.firmware.lit().empty());
  }
  SECTION("at 500 ms it is too late") {
    const Ack ack = std::get<Ack>(bench.ask(KeepAlive{}, shown + 500 * kMillisecond));
    CHECK(ack.faults == kFaultHostSilent);
    CHECK(ack.lit == 0);
  }
  SECTION("however late the controller looks at its clock") {
    bench.firmware.tick(shown + 3 * kSecond);
    CHECK(bench.changes.back() == Change{shown + kHostSilenceLimit, {}});
  }
  SECTION("bytes that are no message do not count") {
    std::vector<std::uint8_t> damaged = encode(KeepAlive{}, 99);
    damaged[15] ^= 1;
    bench.firmware.receive(damaged, shown + 400 * kMillisecond);
    bench.firmware.tick(shown + 500 * kMillisecond);
    CHECK(bench.firmware.lit().empty());
  }
}

TEST_CASE("a controller that went dark by itself says so and waits to be asked", "[led-firmware]") {
  Bench bench;
  bench.ask(Show{kRed}, 0);
  bench.firmware.tick(600 * kMillisecond);
  const auto told = bench.received();
  REQUIRE(told.size() == 1);
  CHECK(told[0].first == 0);  // unasked
  CHECK(std::get<StatusReport>(told[0].second).faults == kFaultHostSilent);
  CHECK(std::get<StatusReport>(told[0].second).lit == 0);

  CHECK(bench.refusal(Show{kRed}, kSecond) == NakReason::kFault);
  CHECK(bench.status(kSecond).faults == kFaultHostSilent);
  CHECK(bench.firmware.lit().empty());
  const bool by_off = GENERATE(true, false);
  if (by_off) CHECK(bench.obeys(Off{}, kSecond));
  if (!by_off) bench.ask(Identify{}, kSecond);
  CHECK(bench.status(kSecond).faults == 0);
  CHECK(bench.obeys(Show{kRed}, kSecond));
}

TEST_CASE("silence while dark is no fault; while armed in the dark it is", "[led-firmware]") {
  Bench bench;
  bench.ask(Identify{}, 0);
  CHECK_FALSE(bench.firmware.next_event());
  bench.firmware.tick(100 * kSecond);
  CHECK(bench.firmware.faults() == 0);
  bench.load({{}, kRed}, 100 * kSecond);
  REQUIRE(bench.obeys(Arm{0, StepSource::kStrobe, StrobeEdge::kFalling}, 100 * kSecond));
  bench.firmware.strobe_edge(false, 100 * kSecond + kHostSilenceLimit);  // a camera that goes on without the host
  CHECK(bench.firmware.lit().empty());
  CHECK(bench.firmware.faults() == kFaultHostSilent);
  CHECK_FALSE(bench.firmware.armed());
  CHECK(bench.changes.empty());
}

TEST_CASE("a command that is repeated is answered alike and not carried out twice", "[led-firmware]") {
  Bench bench;
  bench.load({kRed, kGreen, kTwo}, 0);
  bench.ask(Arm{0, StepSource::kCommand, StrobeEdge::kRising}, 1);
  const LedMessage first = bench.ask_as(50, StepOn{}, 2);
  CHECK(std::get<Ack>(first).position == 1);
  CHECK(bench.ask_as(50, StepOn{}, 3) == first);
  CHECK(bench.ask_as(50, StepOn{}, 4) == first);
  CHECK(bench.firmware.lit() == kGreen);

  // A refusal is repeated too.
  const LedMessage refused = bench.ask_as(51, Show{{{9, 1, 1, 1}}}, 5);
  CHECK(bench.ask_as(51, Show{{{9, 1, 1, 1}}}, 6) == refused);

  // Another command under the last number, and older ones.
  CHECK(std::get<Nak>(bench.ask_as(51, Show{kRed}, 7)).reason == NakReason::kBadSequence);
  CHECK(std::get<Nak>(bench.ask_as(50, StepOn{}, 7)).reason == NakReason::kBadSequence);
  CHECK(bench.firmware.lit() == kGreen);
  // Numbers wrap.
  bench.ask_as(0x7FFFFFFF, KeepAlive{}, 8);
  bench.ask_as(0xFFFFFFFE, KeepAlive{}, 8);
  CHECK(std::holds_alternative<Ack>(bench.ask_as(1, Show{kTwo}, 9)));
  CHECK(std::get<Nak>(bench.ask_as(0xFFFFFFFF, Show{kRed}, 9)).reason == NakReason::kBadSequence);
  // IDENTIFY begins anew, and OFF is obeyed whatever its number.
  CHECK(std::holds_alternative<Ack>(bench.ask_as(0xFFFFFFF0, Off{}, 10)));
  CHECK(bench.firmware.lit().empty());
  CHECK(std::holds_alternative<Identity>(bench.ask_as(0xFFFFFFFF, Identify{}, 11)));
  CHECK(std::holds_alternative<Ack>(bench.ask_as(1, Show{kTwo}, 12)));
}

TEST_CASE("OFF is obeyed in every state", "[led-firmware]") {
  Bench bench;
  bench.load({kRed, kGreen}, 0);
  const auto off = [&](Nanoseconds now) {
    CHECK(std::get<Ack>(bench.ask(Off{}, now)) == Ack{LedMessageType::kOff, LedState::kDark, 0, kNoPosition, 0});
    CHECK(bench.firmware.lit().empty());
    CHECK_FALSE(bench.firmware.armed());
  };
  off(1);
  bench.ask(Show{kTwo}, 2);
  off(3);
  bench.ask(Arm{1, StepSource::kStrobe, StrobeEdge::kRising}, 4);
  off(5);
  bench.ask(Show{kTwo}, 6);
  bench.firmware.tick(kSecond);
  REQUIRE(bench.firmware.faults() != 0);
  off(kSecond);
  // With a payload that does not belong to it, too.
  bench.ask(Show{kTwo}, kSecond);
  std::vector<std::uint8_t> odd = encode(Show{kRed}, 999);
  odd[3] = static_cast<std::uint8_t>(LedMessageType::kOff);
  const std::uint32_t crc = crc32c(std::span(odd).subspan(16), crc32c(std::span(odd).first(12)));
  for (std::size_t i = 0; i < 4; ++i) odd[12 + i] = static_cast<std::uint8_t>(crc >> (8 * i));
  bench.firmware.receive(odd, kSecond + 1);
  CHECK(bench.firmware.lit().empty());
  // Loaded patterns stay.
  bench.received();
  CHECK(bench.ask_as(1000, AskStatus{}, kSecond + 2).index() == LedMessage(StatusReport{}).index());
  CHECK(std::holds_alternative<Ack>(bench.ask_as(1001, Arm{}, kSecond + 2)));
}

TEST_CASE("an output is on for no longer than its limit, to the nanosecond", "[led-firmware]") {
  sim::LedFirmwareOptions options = unlimited();
  options.identity.on_time_limit_ms = 2000;
  Bench bench(options);
  bench.ask(Show{kRed}, 0);
  bench.keep_alive_until(0, 900 * kMillisecond);
  // The same output in another pattern is on all the same; others begin anew.
  bench.ask(Show{{{3, 1, 1, 1}, {4, 1, 1, 1}}}, kSecond);
  bench.keep_alive_until(kSecond, 1900 * kMillisecond);
  CHECK(bench.firmware.next_event() == 2 * kSecond);
  bench.firmware.tick(2 * kSecond - 1);
  CHECK(bench.firmware.lit().size() == 2);
  bench.firmware.tick(2 * kSecond + 7);
  CHECK(bench.changes.back() == Change{2 * kSecond, {}});
  CHECK(bench.firmware.faults() == kFaultOnTime);

  // Off for a moment is off.
  bench.ask(Off{}, 3 * kSecond);
  bench.ask(Show{kRed}, 3 * kSecond);
  bench.keep_alive_until(3 * kSecond, 4900 * kMillisecond);
  bench.ask(Show{}, 5 * kSecond - 1);
  bench.ask(Show{kRed}, 5 * kSecond - 1);
  bench.keep_alive_until(5 * kSecond, 6900 * kMillisecond);
  CHECK(bench.firmware.faults() == 0);
  CHECK(bench.firmware.lit() == kRed);
}

TEST_CASE("duty: an output that was on for too much of the time goes dark and must rest", "[led-firmware]") {
  sim::LedFirmwareOptions options = unlimited();
  options.identity.duty_per_mille = 250;
  options.identity.duty_window_ms = 4000;  // may store 1 s of on-time: from cold, 1 s / (1 - 0.25) in one go
  Bench bench(options);
  const Nanoseconds limit = (kSecond * 4 + 2) / 3;
  bench.ask(Show{kRed}, 0);
  bench.keep_alive_until(0, 1300 * kMillisecond);
  bench.firmware.tick(limit - 1);
  CHECK(bench.firmware.lit() == kRed);
  bench.firmware.tick(limit);
  CHECK(bench.changes.back() == Change{limit, {}});
  CHECK(bench.firmware.faults() == kFaultDuty);

  // It rests until half is left: 0.5 s / 0.25.
  bench.ask(Off{}, limit);
  CHECK(bench.refusal(Show{kRed}, limit + 2 * kSecond - kMillisecond) == NakReason::kResting);
  CHECK(bench.obeys(Show{kGreen}, limit + 2 * kSecond - kMillisecond));  // others need not
  CHECK(bench.obeys(Show{kRed}, limit + 2 * kSecond + kMillisecond));
}

TEST_CASE("duty: in any stretch of time an output is on for no more than its share and the window's",
          "[led-firmware]") {
  sim::LedFirmwareOptions options = unlimited();
  options.identity.duty_per_mille = 200;
  options.identity.duty_window_ms = 1000;
  Bench bench(options);
  // The greedy host: lights the output whenever the controller lets it.
  for (Nanoseconds t = 0; t < 60 * kSecond; t += 7 * kMillisecond) {
    bench.ask(Off{}, t);
    bench.ask(Show{kRed}, t);
  }
  std::vector<std::pair<Nanoseconds, Nanoseconds>> spans;
  for (const Change& change : bench.changes) {
    if (!change.lit.empty()) spans.emplace_back(change.time, 60 * kSecond);
    if (change.lit.empty()) spans.back().second = change.time;
  }
  REQUIRE(spans.size() > 100);
  Nanoseconds worst = 0, total = 0;
  for (std::size_t i = 0; i < spans.size(); ++i) {
    Nanoseconds on = 0;
    for (std::size_t k = i; k < spans.size(); ++k) {
      on += spans[k].second - spans[k].first;
      const Nanoseconds length = spans[k].second - spans[i].first;
      worst = std::max(worst, on - (length + kSecond) / 5);
    }
    total += spans[i].second - spans[i].first;
  }
  CHECK(worst <= Nanoseconds(spans.size()));  // rounded up to a nanosecond each time
  CHECK(total > 60 * kSecond / 5 * 9 / 10);   // and what is allowed is had
}

TEST_CASE("too hot: dark at once, and no light before it has cooled down", "[led-firmware]") {
  Bench bench;
  bench.ask(Show{kRed}, 0);
  bench.firmware.set_temperature(74.9, 1);
  CHECK(bench.firmware.lit() == kRed);
  bench.firmware.set_temperature(75, 2);
  CHECK(bench.changes.back() == Change{2, {}});
  CHECK(bench.firmware.faults() == kFaultTemperature);
  const StatusReport report = std::get<StatusReport>(bench.received().at(0).second);
  CHECK(report.temperature_tenths == 750);

  bench.ask(Off{}, 3);
  CHECK(bench.refusal(Show{kRed}, 3) == NakReason::kFault);
  bench.firmware.set_temperature(65.1, 4);
  bench.ask(Off{}, 4);
  CHECK(bench.refusal(Show{kRed}, 4) == NakReason::kFault);
  bench.firmware.set_temperature(65, 5);
  CHECK(bench.refusal(Show{kRed}, 5) == NakReason::kFault);  // until it is told so
  bench.ask(Off{}, 6);
  CHECK(bench.obeys(Show{kRed}, 6));
}

TEST_CASE("a host that unplugs leaves it dark", "[led-firmware]") {
  Bench bench;
  bench.load({kRed, kGreen}, 0);
  bench.ask(Arm{0, StepSource::kStrobe, StrobeEdge::kFalling}, 1);
  bench.firmware.disconnect(2);
  CHECK(bench.changes.back() == Change{2, {}});
  CHECK_FALSE(bench.firmware.armed());
  bench.firmware.strobe_edge(false, 3);
  CHECK(bench.changes.size() == 2);
  CHECK(bench.firmware.take_output().empty());
  // Half a message of before does not spoil the first of the next host.
  std::vector<std::uint8_t> half = encode(Show{kRed}, 77);
  half.resize(20);
  bench.firmware.receive(half, 4);
  bench.firmware.disconnect(5);
  CHECK(std::holds_alternative<Identity>(bench.ask_as(1, Identify{}, 6)));
}

TEST_CASE("the player steps by command or by the edge it was told, and stops after the last pattern",
          "[led-firmware]") {
  Bench bench;
  bench.load({kRed, {}, kTwo}, 0);
  CHECK(bench.status(0).patterns == 3);

  SECTION("by command") {
    CHECK(std::get<Ack>(bench.ask(Arm{1, StepSource::kCommand, StrobeEdge::kFalling}, 1)) ==
          Ack{LedMessageType::kArm, LedState::kArmed, 0, 1, 0});
    bench.firmware.strobe_edge(false, 2);  // not listened to
    bench.firmware.strobe_edge(true, 2);
    CHECK(bench.changes.empty());
    CHECK(std::get<Ack>(bench.ask(StepOn{}, 3)).position == 2);
    CHECK(bench.firmware.lit() == kTwo);
    const Ack end = std::get<Ack>(bench.ask(StepOn{}, 4));
    CHECK(end == Ack{LedMessageType::kStep, LedState::kArmed, 0, 3, 0});
    CHECK(bench.refusal(StepOn{}, 5) == NakReason::kPastEnd);
    CHECK(bench.changes == std::vector<Change>{{3, kTwo}, {4, {}}});
  }
  SECTION("by strobe") {
    const bool rising = GENERATE(true, false);
    bench.ask(Arm{0, StepSource::kStrobe, rising ? StrobeEdge::kRising : StrobeEdge::kFalling}, 1);
    CHECK(bench.refusal(StepOn{}, 1) == NakReason::kNotArmed);
    for (Nanoseconds t = 10; t < 20; ++t) {
      bench.firmware.strobe_edge(!rising, t * kMillisecond);
      bench.firmware.strobe_edge(rising, t * kMillisecond + 5);
    }
    const auto events = bench.received();
    REQUIRE(events.size() == 3);
    for (std::uint32_t i = 0; i < 3; ++i) {
      CHECK(events[i].first == 0);
      CHECK(std::get<Stepped>(events[i].second) == Stepped{i + 1, i + 1, 10000 + 1000 * i});
    }
    const Nanoseconds t = 10 * kMillisecond + 5;
    CHECK(bench.changes ==
          std::vector<Change>{{1, kRed}, {t, {}}, {t + kMillisecond, kTwo}, {t + 2 * kMillisecond, {}}});
    CHECK(bench.status(20 * kMillisecond).steps == 3);
  }
  SECTION("by strobe, delayed") {
    bench.ask(Arm{0, StepSource::kStrobe, StrobeEdge::kFalling, 200}, 1);
    // All pulses come before the first step is due, and each steps 2 ms after its end; the fourth is beyond the end.
    const Nanoseconds t = 10 * kMillisecond;
    for (const Nanoseconds after : {0, 100, 200, 300}) bench.firmware.strobe_edge(false, t + after);
    CHECK(bench.firmware.next_event() == 12 * kMillisecond);
    bench.firmware.tick(50 * kMillisecond);
    const Nanoseconds due = 12 * kMillisecond;
    CHECK(bench.changes == std::vector<Change>{{1, kRed}, {due, {}}, {due + 100, kTwo}, {due + 200, {}}});
    // What makes it dark forgets what is due.
    bench.ask(Arm{0, StepSource::kStrobe, StrobeEdge::kFalling, 200}, 60 * kMillisecond);
    bench.firmware.strobe_edge(false, 61 * kMillisecond);
    bench.ask(Off{}, 62 * kMillisecond);
    bench.firmware.tick(100 * kMillisecond);
    CHECK(bench.firmware.lit().empty());
    CHECK(bench.status(100 * kMillisecond).steps == 3);
  }
  SECTION("SHOW ends it") {
    bench.ask(Arm{0, StepSource::kStrobe, StrobeEdge::kFalling}, 1);
    bench.ask(Show{kGreen}, 2);
    bench.firmware.strobe_edge(false, 3);
    CHECK(bench.firmware.lit() == kGreen);
    CHECK(bench.refusal(StepOn{}, 4) == NakReason::kNotArmed);
  }
}

TEST_CASE("strobe pulses and STEP while nothing is armed change nothing", "[led-firmware]") {
  Bench bench;
  bench.firmware.strobe_edge(true, 0);
  bench.firmware.strobe_edge(false, 1);
  CHECK(bench.refusal(StepOn{}, 2) == NakReason::kNotArmed);
  bench.load({kRed}, 3);
  bench.firmware.strobe_edge(false, 4);
  CHECK(bench.changes.empty());
  CHECK(bench.received().empty());
}

TEST_CASE("ARM needs a whole sequence and a pattern of it", "[led-firmware]") {
  Bench bench;
  CHECK(bench.refusal(Arm{}, 0) == NakReason::kNotLoaded);
  bench.load({kRed, kGreen}, 1);
  const Nak nak = std::get<Nak>(bench.ask(Arm{2}, 2));
  CHECK(nak.reason == NakReason::kBadIndex);
  CHECK(nak.detail == 2);
  CHECK(bench.obeys(Arm{1}, 3));
  bench.ask(Identify{}, 4);
  CHECK(bench.refusal(Arm{0}, 5) == NakReason::kNotLoaded);
}

TEST_CASE("a sequence is loaded whole or not at all", "[led-firmware]") {
  Bench bench;
  const std::vector<OutputPattern> patterns{kRed, kGreen, kTwo};
  const auto bytes = encode_patterns(patterns);
  const auto total = static_cast<std::uint32_t>(bytes.size());
  const auto part = [&](std::uint32_t begin, std::uint32_t end) {
    return Load{3, total, crc32c(bytes), begin, {bytes.begin() + begin, bytes.begin() + end}};
  };
  bench.load({kGreen}, 0);

  SECTION("in parts") {
    CHECK(bench.obeys(part(0, 7), 1));
    CHECK(bench.refusal(Arm{0}, 2) == NakReason::kNotLoaded);  // what was there before is gone
    CHECK(bench.obeys(part(7, 20), 3));
    CHECK(bench.status(3).patterns == 0);
    CHECK(bench.obeys(part(20, total), 4));
    CHECK(bench.status(4).patterns == 3);
  }
  SECTION("interrupted by other commands, it goes on") {
    bench.ask(part(0, 7), 1);
    bench.ask(Show{kRed}, 2);
    bench.ask(Off{}, 3);
    CHECK(bench.obeys(part(7, total), 4));
    CHECK(bench.obeys(Arm{2}, 5));
    CHECK(bench.firmware.lit() == kTwo);
  }
  SECTION("a part is missing, or is of another sequence") {
    bench.ask(part(0, 7), 1);
    const Nak nak = std::get<Nak>(bench.ask(part(8, 12), 2));
    CHECK(nak.reason == NakReason::kBadOffset);
    CHECK(nak.detail == 7);
    Load other = part(7, 12);
    other.crc ^= 1;
    CHECK(bench.refusal(other, 3) == NakReason::kBadOffset);
    CHECK(bench.obeys(part(7, total), 4));                             // what was refused changed nothing
    CHECK(bench.refusal(part(7, total), 5) == NakReason::kBadOffset);  // it is over
    CHECK(bench.status(5).patterns == 3);
  }
  SECTION("begun anew") {
    bench.ask(part(0, 7), 1);
    CHECK(bench.obeys(part(0, total), 2));
    CHECK(bench.status(2).patterns == 3);
  }
  SECTION("not what was promised") {
    Load wrong = part(0, total);
    wrong.crc ^= 0x10000;
    CHECK(bench.refusal(wrong, 1) == NakReason::kBadChecksum);
    Load miscounted = part(0, total);
    miscounted.patterns = 2;
    CHECK(bench.refusal(miscounted, 2) == NakReason::kBadPayload);
    const auto far = encode_patterns(std::vector<OutputPattern>{{{8, 1, 1, 1}}});
    CHECK(bench.refusal(Load{1, static_cast<std::uint32_t>(far.size()), crc32c(far), 0, far}, 3) ==
          NakReason::kBadOutput);
    CHECK(bench.refusal(Arm{0}, 4) == NakReason::kNotLoaded);
  }
  SECTION("too large") {
    CHECK(bench.refusal(Load{65'537, total, 0, 0, bytes}, 1) == NakReason::kTooLarge);
    CHECK(bench.refusal(Load{1, (16u << 20) + 1, 0, 0, bytes}, 2) == NakReason::kTooLarge);
    CHECK(bench.status(3).patterns == 1);  // what was there stays
  }
  SECTION("while it plays") {
    bench.ask(Arm{0}, 1);
    bench.ask(part(0, 7), 2);
    CHECK(bench.firmware.lit().empty());
    CHECK_FALSE(bench.firmware.armed());
  }
}

TEST_CASE("messages it cannot know are refused, and one that never ends is given up", "[led-firmware]") {
  Bench bench;
  CHECK(bench.refusal(Stepped{}, 0) == NakReason::kUnknownType);
  std::vector<std::uint8_t> endless = encode(Show{kRed}, 10);
  endless[9] = 0x20;
  bench.firmware.receive(endless, kSecond);
  bench.firmware.receive(encode(Show{kRed}, 11), kSecond + kPartialMessageLimit - 1);
  CHECK(bench.firmware.lit().empty());  // it may be what the first one waits for
  bench.firmware.receive(encode(Show{kGreen}, 12), kSecond + 2 * kPartialMessageLimit);
  CHECK(bench.firmware.lit() == kGreen);
  CHECK(bench.received().size() == 2);
}
