#include "capture/usb/dmx_message.h"

#include <catch2/catch.hpp>
#include <random>

using namespace lightstage;
using namespace lightstage::capture;

namespace {

using Bytes = std::vector<std::uint8_t>;

DmxMessage random_message(std::mt19937_64& random, std::size_t max_data = kMaxDmxData) {
  DmxMessage message{std::uint8_t(random()), Bytes(random() % (max_data + 1))};
  for (std::uint8_t& byte : message.data) byte = std::uint8_t(random());
  return message;
}

std::vector<DmxMessage> messages_in(const Bytes& stream) {
  DmxReader reader;
  reader.feed(stream);
  std::vector<DmxMessage> messages;
  while (std::optional<DmxMessage> message = reader.next()) messages.push_back(std::move(*message));
  return messages;
}

}  // namespace

TEST_CASE("a widget's messages look as Enttec gives them", "[dmx]") {
  CHECK(encode(DmxMessage{3, {0, 0}}) == Bytes{0x7E, 3, 2, 0, 0, 0, 0xE7});
  CHECK(encode(DmxMessage{10, {}}) == Bytes{0x7E, 10, 0, 0, 0xE7});
  const Bytes channels(512, 7);
  const Bytes universe = encode(dmx_frame(channels));
  CHECK(universe.size() == 518);
  CHECK(Bytes(universe.begin(), universe.begin() + 6) == Bytes{0x7E, 6, 0x01, 0x02, 0, 7});
  const DmxMessage shortest = dmx_frame(std::span(channels).first(2));
  CHECK(shortest.data.size() == 25);
  CHECK(Bytes(shortest.data.begin(), shortest.data.begin() + 4) == Bytes{0, 7, 7, 0});
}

TEST_CASE("a widget's messages come back as they were sent, and cut ones are incomplete", "[dmx]") {
  std::mt19937_64 random(1);
  for (int i = 0; i < 300; ++i) {
    const DmxMessage message = random_message(random);
    const Bytes bytes = encode(message);
    CHECK(messages_in(bytes) == std::vector<DmxMessage>{message});
    DmxReader reader;
    const std::size_t cut = random() % bytes.size();
    reader.feed(std::span(bytes).first(cut));
    REQUIRE_FALSE(reader.next());
    CHECK(reader.partial() == (cut > 0));
    reader.feed(std::span(bytes).subspan(cut));
    CHECK(reader.next() == message);
  }
}

TEST_CASE("every truncation of a widget's message is incomplete, every flipped bit of its frame is refused", "[dmx]") {
  const DmxMessage message{3, {1, 2, 3, 4, 5, 6}};
  const Bytes bytes = encode(message);
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    CHECK(messages_in(Bytes(bytes.begin(), bytes.begin() + std::ptrdiff_t(length))).empty());
  }
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    Bytes flipped = bytes;
    flipped[bit / 8] ^= std::uint8_t(1 << (bit % 8));
    const std::vector<DmxMessage> found = messages_in(flipped);
    const std::size_t at = bit / 8;
    const bool of_the_frame = at == 0 || at == 2 || at == 3 || at + 1 == bytes.size();
    // There is no checksum: a label or data that changed are what they are.
    CHECK(found.empty() == of_the_frame);
    if (!of_the_frame) CHECK(found[0] != message);
  }
}

TEST_CASE("a widget's messages are found between garbage; too long ones are not waited for", "[dmx]") {
  std::mt19937_64 random(2);
  for (int i = 0; i < 100; ++i) {
    Bytes stream;
    std::vector<DmxMessage> sent;
    for (int k = 0; k < 5; ++k) {
      for (std::size_t n = random() % 20; n > 0; --n) stream.push_back(std::uint8_t(random() % 0x7E));
      sent.push_back(random_message(random, 40));
      const Bytes bytes = encode(sent.back());
      stream.insert(stream.end(), bytes.begin(), bytes.end());
    }
    CHECK(messages_in(stream) == sent);
  }
  DmxReader reader;
  reader.feed(Bytes{0x7E, 3, 0x59, 0x02});  // 601 bytes
  CHECK_FALSE(reader.next());
  CHECK_FALSE(reader.partial());
  for (int i = 0; i < 300; ++i) {
    Bytes garbage(random() % 2000);
    for (std::uint8_t& byte : garbage) byte = random() % 4 == 0 ? 0x7E : std::uint8_t(random() % 5);
    reader.feed(garbage);
    while (reader.next()) FAIL("a message without an end");
  }
}

TEST_CASE("a widget's message that never ends hides those behind it only until it is given up", "[dmx]") {
  Bytes stream{0x7E, 6, 200, 0, 1, 2, 3};
  const Bytes good = encode(DmxMessage{3, {9}});
  stream.insert(stream.end(), good.begin(), good.end());
  DmxReader reader;
  reader.feed(stream);
  CHECK_FALSE(reader.next());
  std::optional<DmxMessage> found;
  while (reader.partial() && !found) {
    reader.give_up_partial();
    found = reader.next();
  }
  CHECK(found == DmxMessage{3, {9}});
}

TEST_CASE("a widget's parameters are read, or refused where they cannot be", "[dmx]") {
  const DmxParameters parameters = decode_parameters({3, {0x2C, 0x01, 9, 1, 40, 99}}).value();
  CHECK(parameters == DmxParameters{300, 96'030, 10'670, 40});
  CHECK_FALSE(decode_parameters({3, {0, 0, 9, 1}}));
  CHECK_FALSE(decode_parameters({5, {0, 0, 9, 1, 40}}));
  CHECK_FALSE(decode_parameters({3, {0, 0, 9, 1, 41}}));
}

TEST_CASE("dimmers have a pattern after two frames of it", "[dmx]") {
  const DmxParameters fast;
  CHECK(dmx_settling(512, fast) == 2 * (88'000 + 8'000 + 513 * 44'000));
  CHECK(dmx_settling(512, fast) < 46 * core::kMillisecond);
  CHECK(dmx_settling(3, fast) == 2 * (96'000 + 25 * 44'000));
  CHECK(dmx_settling(3, DmxParameters{0, 88'000, 8'000, 40}) == 50 * core::kMillisecond);
  CHECK(dmx_settling(512, DmxParameters{0, 1'000'000, 500'000, 0}) == 2 * (1'500'000 + 513 * 44'000));
  CHECK(dmx_settling(512, DmxParameters{0, 0, 0, 0}) == dmx_settling(512, fast));
}

TEST_CASE("the status bytes of an FTDI chip are taken off every packet", "[dmx]") {
  Bytes transfer, data;
  std::mt19937_64 random(3);
  for (int packet = 0; packet < 4; ++packet) {
    transfer.insert(transfer.end(), {0x01, 0x60});
    const int count = packet < 3 ? 62 : 10;
    for (int i = 0; i < count; ++i) {
      data.push_back(std::uint8_t(random()));
      transfer.push_back(data.back());
    }
  }
  CHECK(without_ftdi_status(transfer, 64) == data);
  CHECK(without_ftdi_status({}, 64).empty());
  CHECK(without_ftdi_status(Bytes{1, 0x60}, 64).empty());
  CHECK(without_ftdi_status(Bytes{1}, 64).empty());
  CHECK(without_ftdi_status(Bytes(514, 5), 512).size() == 510);
}
