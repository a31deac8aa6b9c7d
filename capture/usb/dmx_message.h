// The messages of Enttec's DMX USB Pro and of widgets compatible with it, as Enttec's "DMX USB Pro Widget API 1.44" gives them:
//
//   0x7E   label   length of the data, u16 little-endian, at most 600   data   0xE7
//
// There is no checksum: what is damaged within the data is not noticed. Room-internal.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/clock.h"

namespace lightstage::capture {

enum class DmxLabel : std::uint8_t {
  kParameters = 3,    // request: u16 of user configuration wanted; reply: DmxParameters
  kSendDmx = 6,       // start code, then the channels; no reply, and repeated by the widget for ever
  kSerialNumber = 10  // request: empty; reply: u32, 8 decimal digits as BCD
};

constexpr std::size_t kMaxDmxData = 600, kDmxChannels = 512;
constexpr std::size_t kMinDmxChannels = 24;  // the shortest that widgets send

struct DmxMessage {
  std::uint8_t label = 0;
  std::vector<std::uint8_t> data;  // at most kMaxDmxData
  friend bool operator==(const DmxMessage&, const DmxMessage&) = default;
};

std::vector<std::uint8_t> encode(const DmxMessage& message);

// Finds messages in a stream of bytes as MessageReader does (capture/led_protocol.h).
class DmxReader {
 public:
  void feed(std::span<const std::uint8_t> bytes) { buffer_.insert(buffer_.end(), bytes.begin(), bytes.end()); }
  std::optional<DmxMessage> next();
  bool partial() const { return !buffer_.empty(); }
  void give_up_partial();

 private:
  std::vector<std::uint8_t> buffer_;
};

// Reply to label 3.
struct DmxParameters {
  std::uint16_t firmware = 0;
  core::Nanoseconds break_time = 88'000, mark_time = 8'000;  // in units of 10.67 us, rounded up
  int rate = 0;                                              // DMX frames per second, 0: as many as fit
  friend bool operator==(const DmxParameters&, const DmxParameters&) = default;
};
std::optional<DmxParameters> decode_parameters(const DmxMessage& message);

// A whole universe's message: start code 0, then the channels, filled up to the shortest that can be sent.
DmxMessage dmx_frame(std::span<const std::uint8_t> channels);

// How long after a frame of so many channels was handed over the dimmers have surely got it: the widget may just have begun
// to repeat the last one, so twice the time from the beginning of one frame to that of the next. 44 us is a slot of 11 bits at
// 250 kbit/s; the start code is one more slot. Break and mark are never taken for shorter than 88 and 8 us.
core::Nanoseconds dmx_settling(std::size_t channels, const DmxParameters& parameters);

// The data of a transfer from an FTDI chip: each packet of it begins with two bytes of modem status.
std::vector<std::uint8_t> without_ftdi_status(std::span<const std::uint8_t> transfer, std::size_t packet_bytes);

}  // namespace lightstage::capture
