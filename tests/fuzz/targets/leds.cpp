// The LED wire protocol, from both sides, and the DMX widget's.
#include <algorithm>

#include "capture/led_protocol.h"
#include "capture/protocol_leds.h"
#include "capture/usb/dmx_message.h"
#include "fuzz/target.h"
#include "sim/led_firmware.h"

namespace lightstage::fuzz {

namespace {

// A whole message with this payload and a sound checksum, which bytes at random would never have.
std::vector<std::uint8_t> framed(std::uint8_t type, std::uint32_t sequence, Bytes payload) {
  std::vector<std::uint8_t> bytes{'L', 'S', capture::kLedProtocolVersion, type};
  const auto put = [&](std::uint32_t value) {
    for (int i = 0; i < 4; ++i) bytes.push_back(std::uint8_t(value >> (8 * i)));
  };
  put(sequence);
  put(std::uint32_t(payload.size()));
  const std::uint32_t crc = capture::crc32c(payload, capture::crc32c(bytes));
  put(crc);
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  return bytes;
}

const Registration kProtocol(
    {"led_protocol", [](Bytes bytes) {
       Input input(bytes);
       const capture::LedFrame frame{input.byte(), 7, {input.rest().begin(), input.rest().end()}};
       capture::MessageReader reader;
       reader.feed(bytes);
       reader.feed(framed(frame.type, 7, bytes.subspan(std::min<std::size_t>(1, bytes.size()))));
       const auto look = [](const capture::LedFrame& found) {
         const auto message = capture::decode(found);
         if (!message) return;
         const auto again = capture::encode(*message, found.sequence);
         capture::MessageReader second;
         second.feed(again);
         const auto read = second.next();
         require(read && capture::decode(*read) == message, "a message reads back");
       };
       do {
         while (const auto found = reader.next()) look(*found);
         if (reader.partial()) reader.give_up_partial();
       } while (reader.partial());
       for (const std::size_t count : {1, 3, 65'536}) {
         const auto patterns = capture::decode_patterns(bytes, count);
         require(!patterns || patterns->size() == count, "as many patterns as promised");
       }
     }});

const Registration kFirmware({"led_firmware", [](Bytes bytes) {
                                Input input(bytes);
                                sim::LedFirmwareOptions options;
                                core::Nanoseconds last_change = 0;
                                const auto on_change = [&](core::Nanoseconds time,
                                                           std::span<const capture::OutputLevel> lit) {
                                  require(time >= last_change, "time does not go back");
                                  last_change = time;
                                  for (const auto& level : lit) {
                                    require(level.output < options.identity.outputs, "only outputs that are there");
                                  }
                                };
                                sim::LedFirmware firmware(options, on_change);
                                core::Nanoseconds now = 0;
                                std::uint32_t sequence = 0;
                                while (!input.empty()) {
                                  switch (input.byte() % 7) {
                                    case 0: {
                                      firmware.receive(input.take(input.byte()), now);
                                      break;
                                    }
                                    case 1: {
                                      const std::uint8_t type = input.byte();
                                      const Bytes payload = input.take(input.number(2) % 2048);
                                      firmware.receive(framed(type, ++sequence, payload), now);
                                      break;
                                    }
                                    case 2:
                                      firmware.strobe_edge(input.byte() % 2 == 0, now);
                                      break;
                                    case 3:
                                      now += core::Nanoseconds(input.number(2)) * core::kMillisecond;
                                      break;
                                    case 4:
                                      now += core::Nanoseconds(input.number(5));
                                      firmware.tick(now);
                                      break;
                                    case 5:
                                      firmware.set_temperature(double(input.byte()) - 40, now);
                                      break;
                                    default:
                                      firmware.disconnect(now);
                                  }
                                  if (firmware.faults() != 0)
                                    require(firmware.lit().empty(), "dark where there is a fault");
                                  firmware.take_output();
                                }
                              }});

// A controller that answers with whatever the input says.
class StrangeLink final : public capture::LedLink {
 public:
  StrangeLink(Bytes bytes, core::Clock& clock) : input_(bytes), clock_(clock) {}

  void write(std::span<const std::uint8_t> bytes, core::Nanoseconds) override {
    for (std::size_t i = 4; i < 8 && i < bytes.size(); ++i) {
      sequence_ = i == 4 ? bytes[i] : sequence_ | std::uint32_t(bytes[i]) << (8 * (i - 4));
    }
  }
  std::vector<std::uint8_t> read(core::Nanoseconds deadline) override {
    const std::uint8_t kind = input_.byte() % 4;
    if (input_.empty() || kind == 0) {
      clock_.sleep_until(deadline);
      return {};
    }
    if (kind == 1) {
      const Bytes raw = input_.take(input_.byte());
      return {raw.begin(), raw.end()};
    }
    const std::uint8_t type = input_.byte();
    const Bytes payload = input_.take(input_.byte());
    return framed(type, kind == 2 ? sequence_ : 0, payload);
  }

 private:
  Input input_;
  core::Clock& clock_;
  std::uint32_t sequence_ = 0;
};

const Registration kHost({"led_host", [](Bytes bytes) {
                            core::VirtualClock clock;
                            capture::ProtocolLedsOptions options{.output_of_light = {0, 1, 2}, .keep_alive = false};
                            // A good beginning, so that more than the greeting is reached.
                            capture::Identity identity;
                            identity.outputs = 8;
                            identity.max_payload = capture::kMaxLedPayload;
                            identity.max_patterns = 100;
                            identity.max_sequence_bytes = 10'000;
                            const auto hello = capture::encode(identity, 0);
                            std::vector<std::uint8_t> script{2, std::uint8_t(capture::LedMessageType::kIdentity),
                                                             std::uint8_t(hello.size() - capture::kLedHeaderBytes)};
                            script.insert(script.end(), hello.begin() + capture::kLedHeaderBytes, hello.end());
                            const bool greets = bytes.empty() || bytes[0] % 4 != 3;
                            if (!greets) script.clear();
                            script.insert(script.end(), bytes.begin(), bytes.end());
                            capture::ProtocolLeds leds(std::make_unique<StrangeLink>(script, clock), options, clock);
                            const std::vector<capture::LightLevel> one{{1}};
                            const std::vector<std::vector<capture::LightLevel>> patterns{one, {}, one};
                            tolerate([&] { leds.show(one); });
                            tolerate([&] { leds.status(); });
                            if (capture::PatternPlayer* player = leds.player()) {
                              tolerate([&] { player->load(patterns); });
                              tolerate([&] { player->arm(0, core::kMillisecond); });
                              tolerate([&] { player->position(); });
                              tolerate([&] { player->wait_for_pattern(1, clock.now() + core::kSecond); });
                            }
                            tolerate([&] { leds.all_off(); });
                          }});

const Registration kDmx({"dmx", [](Bytes bytes) {
                           capture::DmxReader reader;
                           for (const std::size_t packet : {1, 2, 3, 64}) capture::without_ftdi_status(bytes, packet);
                           reader.feed(bytes);
                           do {
                             while (const auto message = reader.next()) {
                               require(message->data.size() <= capture::kMaxDmxData, "no more data than there may be");
                               if (const auto parameters = capture::decode_parameters(*message)) {
                                 require(capture::dmx_settling(512, *parameters) > 0, "settling takes time");
                               }
                             }
                             if (reader.partial()) reader.give_up_partial();
                           } while (reader.partial());
                         }});

}  // namespace

}  // namespace lightstage::fuzz
