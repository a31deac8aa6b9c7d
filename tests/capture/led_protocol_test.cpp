#include "capture/led_protocol.h"

#include <catch2/catch.hpp>
#include <map>
#include <random>
#include <set>

#include "core/file.h"
#include "led_examples.h"

using namespace lightstage;
using namespace lightstage::capture;

namespace {

using Bytes = std::vector<std::uint8_t>;

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  std::uint64_t below(std::uint64_t n) { return engine_() % n; }
  std::uint8_t u8() { return static_cast<std::uint8_t>(engine_()); }
  std::uint16_t u16() { return static_cast<std::uint16_t>(engine_()); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(engine_()); }
  std::uint64_t u64() { return engine_(); }
  Bytes bytes(std::size_t count) {
    Bytes b(count);
    for (std::uint8_t& v : b) v = u8();
    return b;
  }

 private:
  std::mt19937_64 engine_;
};

OutputPattern random_pattern(Random& random, std::size_t max_size) {
  std::set<std::uint16_t> outputs;
  for (std::size_t i = random.below(max_size + 1); i > 0; --i) {
    outputs.insert(static_cast<std::uint16_t>(random.below(kMaxLedOutputs)));
  }
  OutputPattern pattern;
  for (const std::uint16_t output : outputs) pattern.push_back({output, random.u16(), random.u16(), random.u16()});
  return pattern;
}

LedMessage random_message(Random& random, std::size_t kind) {
  const auto command = [&] { return static_cast<LedMessageType>(1 + random.below(8)); };
  const auto state = [&] { return static_cast<LedState>(random.below(3)); };
  switch (kind) {
    case 0:
      return Identify{};
    case 1:
      return Show{random_pattern(random, 40)};
    case 2: {
      const Bytes bytes = random.bytes(1 + random.below(200));
      const std::uint32_t offset = random.u32() / 2;
      const auto rest = static_cast<std::uint32_t>(random.below(1000));
      return Load{random.u32(), offset + static_cast<std::uint32_t>(bytes.size()) + rest, random.u32(), offset, bytes};
    }
    case 3:
      return Arm{random.u32(), StepSource(random.below(2)), StrobeEdge(random.below(2)),
                 static_cast<std::uint16_t>(random.u32())};
    case 4:
      return StepOn{};
    case 5:
      return AskStatus{};
    case 6:
      return Off{};
    case 7:
      return KeepAlive{};
    case 8:
      return Ack{command(), state(), random.u16(), random.u32(), random.u32()};
    case 9:
      return Nak{command(), NakReason(1 + random.below(13)), random.u32(), random.u32()};
    case 10: {
      Identity m;
      m.protocol = random.u16();
      m.firmware_major = random.u16();
      m.firmware_minor = random.u16();
      m.outputs = static_cast<std::uint16_t>(random.below(kMaxLedOutputs + 1));
      m.colours = random.below(2) ? 3 : 1;
      m.duty_per_mille = static_cast<std::uint16_t>(random.below(1001));
      m.duty_window_ms = random.u32();
      m.on_time_limit_ms = random.u32();
      m.max_payload = random.u32();
      m.max_patterns = random.u32();
      m.max_sequence_bytes = random.u32();
      m.temperature_limit_tenths = static_cast<std::int16_t>(random.u16());
      for (std::size_t i = random.below(29); i > 0; --i) m.serial += char('!' + random.below(94));
      return m;
    }
    case 11:
      return StatusReport{static_cast<std::int16_t>(random.u16()),
                          random.u16(),
                          random.u32(),
                          random.u32(),
                          random.u32(),
                          random.u32(),
                          random.u32(),
                          random.u64(),
                          state()};
    default:
      return Stepped{random.u32(), random.u32(), random.u64()};
  }
}

constexpr std::size_t kKinds = std::variant_size_v<LedMessage>;

std::vector<LedFrame> frames_in(const Bytes& stream) {
  MessageReader reader;
  reader.feed(stream);
  std::vector<LedFrame> frames;
  while (std::optional<LedFrame> frame = reader.next()) frames.push_back(std::move(*frame));
  return frames;
}

// The same by its definition, bit by bit.
std::uint32_t slow_crc32c(const Bytes& bytes) {
  std::uint32_t crc = 0xFFFFFFFF;
  for (const std::uint8_t byte : bytes) {
    for (int bit = 0; bit < 8; ++bit) {
      const bool feedback = ((crc ^ (byte >> bit)) & 1) != 0;
      crc >>= 1;
      if (feedback) crc ^= 0x82F63B78;
    }
  }
  return crc ^ 0xFFFFFFFF;
}

void append(Bytes& to, const Bytes& bytes) {
  to.insert(to.end(), bytes.begin(), bytes.end());
}

}  // namespace

TEST_CASE("the checksum is CRC-32C, by the table as bit by bit", "[led-protocol]") {
  const std::string digits = "123456789";
  CHECK(crc32c(Bytes(digits.begin(), digits.end())) == 0xE3069283);
  CHECK(crc32c({}) == 0);
  CHECK(crc32c(Bytes(32, 0)) == 0x8A9136AA);  // RFC 3720, B.4
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const Bytes bytes = random.bytes(random.below(300));
    CHECK(crc32c(bytes) == slow_crc32c(bytes));
    const std::size_t cut = random.below(bytes.size() + 1);
    const std::span all(bytes);
    CHECK(crc32c(all.subspan(cut), crc32c(all.first(cut))) == slow_crc32c(bytes));
  }
}

TEST_CASE("every message comes back as it was sent", "[led-protocol]") {
  Random random(2);
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    for (int i = 0; i < 200; ++i) {
      const LedMessage message = random_message(random, kind);
      REQUIRE(message.index() == kind);
      const std::uint32_t sequence = random.u32();
      const std::vector<LedFrame> frames = frames_in(encode(message, sequence));
      REQUIRE(frames.size() == 1);
      CHECK(frames[0].sequence == sequence);
      CHECK(frames[0].type == static_cast<std::uint8_t>(type_of(message)));
      CHECK(decode(frames[0]) == message);
    }
  }
}

TEST_CASE("the largest message fits and a larger one is not waited for", "[led-protocol]") {
  Show all;
  for (std::size_t i = 0; i < kMaxLedOutputs; ++i) all.pattern.push_back({static_cast<std::uint16_t>(i), 1, 2, 3});
  Bytes bytes = encode(all, 7);
  CHECK(bytes.size() == kMaxLedMessage);
  REQUIRE(frames_in(bytes).size() == 1);
  CHECK(decode(frames_in(bytes)[0]) == LedMessage(all));

  bytes = encode(Off{}, 1);
  bytes[8] = 0x05;  // length: one more than the limit, 0x8005
  bytes[9] = 0x80;
  MessageReader reader;
  reader.feed(bytes);
  CHECK_FALSE(reader.next());
  CHECK_FALSE(reader.partial());
}

TEST_CASE("a message that was cut short is incomplete, at every length", "[led-protocol]") {
  Random random(3);
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    for (int i = 0; i < 5; ++i) {
      const Bytes whole = encode(random_message(random, kind), random.u32());
      for (std::size_t length = 0; length < whole.size(); ++length) {
        MessageReader reader;
        reader.feed(std::span(whole).first(length));
        REQUIRE_FALSE(reader.next());
        REQUIRE(reader.partial() == (length > 0));
        reader.feed(std::span(whole).subspan(length));
        REQUIRE(reader.next());
      }
    }
  }
}

TEST_CASE("a payload of any other length is refused though its checksum is good", "[led-protocol]") {
  Random random(4);
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    const LedMessage message = random_message(random, kind);
    const LedFrame whole = frames_in(encode(message, 1))[0];
    LedFrame longer = whole;
    longer.payload.push_back(0);
    const bool a_load = type_of(message) == LedMessageType::kLoad;  // whose length is free, within its sequence
    if (!a_load) CHECK_FALSE(decode(longer));
    for (std::size_t length = 0; length < whole.payload.size(); ++length) {
      if (a_load && length > 16) continue;
      CHECK_FALSE(
          decode({whole.type, 1, Bytes(whole.payload.begin(), whole.payload.begin() + std::ptrdiff_t(length))}));
    }
  }
}

TEST_CASE("every flipped bit of every message is refused", "[led-protocol]") {
  Random random(5);
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    for (int i = 0; i < 3; ++i) {
      const Bytes whole = encode(random_message(random, kind), random.u32());
      for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
        Bytes flipped = whole;
        flipped[bit / 8] ^= std::uint8_t(1 << (bit % 8));
        MessageReader reader;
        reader.feed(flipped);
        REQUIRE_FALSE(reader.next());
        while (reader.partial()) {
          reader.give_up_partial();
          REQUIRE_FALSE(reader.next());
        }
      }
    }
  }
}

TEST_CASE("values without a meaning are refused", "[led-protocol]") {
  const auto with = [](const LedMessage& message, std::size_t at, std::uint8_t value) {
    LedFrame frame = frames_in(encode(message, 1))[0];
    frame.payload.at(at) = value;
    return decode(frame);
  };
  CHECK_FALSE(with(Arm{}, 4, 2));                                // step source
  CHECK_FALSE(with(Arm{}, 5, 2));                                // edge
  CHECK_FALSE(with(Ack{}, 1, 3));                                // state
  CHECK_FALSE(with(StatusReport{}, 32, 3));                      // state
  CHECK_FALSE(with(Identity{}, 8, 2));                           // colours
  CHECK_FALSE(with(Identity{}, 11, 4));                          // duty of 1024 or more per mille
  CHECK_FALSE(with(Identity{}, 7, 0x11));                        // more than 4096 outputs
  CHECK_FALSE(with(Identity{}, 36, 0x1B));                       // a serial number that is not printable
  CHECK_FALSE(with(Identity{}, 40, 'x'));                        // text after the serial number's end
  CHECK_FALSE(with(Show{{{1, 1, 1, 1}, {2, 2, 2, 2}}}, 12, 1));  // an output twice
  CHECK_FALSE(with(Show{{{1, 1, 1, 1}, {2, 2, 2, 2}}}, 12, 0));  // falling order
  CHECK_FALSE(with(Show{{{1, 1, 1, 1}}}, 5, 0x10));              // output 4097
  CHECK(with(Arm{}, 6, 9) == LedMessage(Arm{.delay = 9}));
  // A LOAD whose bytes end after its sequence, also where the sum does not fit into 32 bits.
  CHECK_FALSE(decode(frames_in(encode(Load{1, 10, 0, 8, Bytes(3)}, 1))[0]));
  CHECK_FALSE(decode(frames_in(encode(Load{1, 10, 0, 0xFFFFFFFF, Bytes(3)}, 1))[0]));
  CHECK_FALSE(decode(frames_in(encode(Load{1, 10, 0, 0, {}}, 1))[0]));
  CHECK_FALSE(decode(LedFrame{0x42, 1, {}}));
}

TEST_CASE("random bytes are no messages and are not kept", "[led-protocol]") {
  Random random(6);
  for (int i = 0; i < 300; ++i) {
    MessageReader reader;
    Bytes garbage = random.bytes(random.below(3000));
    // Half of them look like messages at places.
    for (std::size_t k = 0; i % 2 == 0 && k + 12 < garbage.size(); k += 1 + random.below(100)) {
      garbage[k] = 'L';
      garbage[k + 1] = 'S';
      garbage[k + 2] = kLedProtocolVersion;
      garbage[k + 10] = garbage[k + 11] = 0;
    }
    reader.feed(garbage);
    CHECK_FALSE(reader.next());
    // Whatever the reader still waits for ends somewhere.
    reader.feed(Bytes(kMaxLedMessage));
    CHECK_FALSE(reader.next());
    CHECK_FALSE(reader.partial());
  }
}

TEST_CASE("random payloads of every type are decoded or refused, and what is decoded is canonical", "[led-protocol]") {
  Random random(7);
  std::size_t decoded = 0;
  for (int i = 0; i < 20000; ++i) {
    const auto type = static_cast<std::uint8_t>(random.below(2) ? 1 + random.below(8) : 0x80 + random.below(5));
    Bytes payload = random.bytes(random.below(70));
    if (random.below(2)) std::fill(payload.begin(), payload.end(), std::uint8_t(random.below(3)));
    const LedFrame frame{type, 1, payload};
    if (const std::optional<LedMessage> message = decode(frame)) {
      ++decoded;
      CHECK(decode(frames_in(encode(*message, 1))[0]) == message);
    }
  }
  CHECK(decoded > 100);
}

TEST_CASE("messages are found between garbage, however the stream is cut", "[led-protocol]") {
  Random random(8);
  for (int i = 0; i < 100; ++i) {
    Bytes stream;
    std::vector<LedMessage> sent;
    for (int k = 0; k < 8; ++k) {
      sent.push_back(random_message(random, random.below(kKinds)));
      append(stream, encode(sent.back(), std::uint32_t(k)));
      Bytes garbage = random.bytes(random.below(30));
      std::replace(garbage.begin(), garbage.end(), std::uint8_t('L'), std::uint8_t('l'));
      append(stream, garbage);
    }
    MessageReader reader;
    std::vector<LedMessage> received;
    for (std::size_t at = 0; at < stream.size();) {
      const std::size_t count = std::min(stream.size() - at, std::size_t(1 + random.below(40)));
      reader.feed(std::span(stream).subspan(at, count));
      at += count;
      while (const std::optional<LedFrame> frame = reader.next()) received.push_back(*decode(*frame));
    }
    CHECK(received == sent);
  }
}

TEST_CASE("a message that never ends hides those behind it only until it is given up", "[led-protocol]") {
  Bytes stream = encode(Show{{{1, 2, 3, 4}}}, 1);
  stream[9] = 0x10;  // now 4 KiB long
  append(stream, encode(Off{}, 2));
  MessageReader reader;
  reader.feed(stream);
  CHECK_FALSE(reader.next());
  REQUIRE(reader.partial());
  std::optional<LedFrame> found;
  while (reader.partial() && !found) {
    reader.give_up_partial();
    found = reader.next();
  }
  REQUIRE(found);
  CHECK(decode(*found) == LedMessage(Off{}));
}

TEST_CASE("sequences come back whole, and cut or miscounted ones are refused", "[led-protocol]") {
  Random random(9);
  for (int i = 0; i < 50; ++i) {
    std::vector<OutputPattern> patterns(1 + random.below(20));
    for (OutputPattern& pattern : patterns) pattern = random_pattern(random, 6);
    const Bytes bytes = encode_patterns(patterns);
    CHECK(decode_patterns(bytes, patterns.size()) == patterns);
    CHECK_FALSE(decode_patterns(bytes, patterns.size() - 1));
    CHECK_FALSE(decode_patterns(bytes, patterns.size() + 1));
    CHECK_FALSE(decode_patterns(std::span(bytes).first(bytes.size() - 1), patterns.size()));
  }
  CHECK_FALSE(decode_patterns(Bytes(8), 0xFFFFFFFF));  // nothing is reserved for so many
}

namespace {

std::string hex(const Bytes& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

// The document's blocks that begin with "```hex NAME", without white space.
std::map<std::string, std::string> documented_examples() {
  const std::string text = core::read_text_file(LIGHTSTAGE_DOCS "/led-protocol.md");
  const std::string begin = "```hex ", end = "```";
  std::map<std::string, std::string> examples;
  for (std::size_t at = text.find(begin); at != std::string::npos; at = text.find(begin, at)) {
    at += begin.size();
    const std::size_t name_end = text.find('\n', at), block_end = text.find(end, at);
    std::string block = text.substr(name_end, block_end - name_end);
    std::erase_if(block, [](char c) { return c == ' ' || c == '\n'; });
    examples[text.substr(at, name_end - at)] = block;
    at = block_end + end.size();
  }
  return examples;
}

}  // namespace

TEST_CASE("the document shows the bytes that are sent, of every type", "[led-protocol]") {
  std::map<std::string, std::string> documented = documented_examples();
  std::set<LedMessageType> types;
  for (const test::LedExample& example : test::led_examples()) {
    INFO(example.name);
    CHECK(documented[example.name] == hex(encode(example.message, example.sequence)));
    CHECK(example.name == to_string(type_of(example.message)));
    documented.erase(example.name);
    types.insert(type_of(example.message));
  }
  CHECK(documented.empty());
  CHECK(types.size() == kKinds);
}
