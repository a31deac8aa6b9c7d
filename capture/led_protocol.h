// The project's own protocol between host and LED controller, as bytes: docs/led-protocol.md is its specification, with
// what a controller does on each message. Nothing here waits, talks or throws; both sides use it.
//
// A message is a header of 16 bytes and a payload, all numbers little-endian:
//
//   0 'L'   1 'S'   2 version (1)   3 type   4 sequence u32   8 payload length u32   12 CRC-32C u32   16 payload
//
// The checksum covers bytes 0 to 11 and the payload.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/clock.h"

namespace lightstage::capture {

// What a controller's USB interface says of itself; vendor and product number are the maker's own affair. 1209:0001 is for
// prototypes (pid.codes gives it to nobody).
constexpr std::uint8_t kLedUsbClass = 0xFF, kLedUsbSubclass = 0x4C, kLedUsbProtocol = 0x53;

constexpr std::uint8_t kLedProtocolVersion = 1;
constexpr std::size_t kLedHeaderBytes = 16;
constexpr std::size_t kMaxLedOutputs = 4096;                    // of one controller
constexpr std::size_t kMaxLedPayload = 4 + 8 * kMaxLedOutputs;  // a SHOW of every output
constexpr std::size_t kMaxLedMessage = kLedHeaderBytes + kMaxLedPayload;

// The controller goes dark when it has heard nothing valid for this long.
constexpr core::Nanoseconds kHostSilenceLimit = 500 * core::kMillisecond;
// A message whose bytes stop coming for this long is given up (see MessageReader::give_up_partial).
constexpr core::Nanoseconds kPartialMessageLimit = 50 * core::kMillisecond;

enum class LedMessageType : std::uint8_t {
  kIdentify = 0x01,
  kShow = 0x02,
  kLoad = 0x03,
  kArm = 0x04,
  kStep = 0x05,
  kStatus = 0x06,
  kOff = 0x07,
  kKeepAlive = 0x08,
  kAck = 0x80,
  kNak = 0x81,
  kIdentity = 0x82,
  kStatusReport = 0x83,
  kStepped = 0x84,
};
std::string_view to_string(LedMessageType type);  // "SHOW"

// CRC-32C (Castagnoli): polynomial 0x1EDC6F41 reflected, start and final inversion; of "123456789" it is 0xE3069283.
// Pass the checksum of what came before to go on.
std::uint32_t crc32c(std::span<const std::uint8_t> bytes, std::uint32_t before = 0);

// ---- what the host sends

// One output's brightness, linear, 65535 is full. An output of a single colour gives the mean of the three.
struct OutputLevel {
  std::uint16_t output = 0, r = 0, g = 0, b = 0;
  friend bool operator==(const OutputLevel&, const OutputLevel&) = default;
};
// Outputs that are not named are off. In rising order of output, none twice.
using OutputPattern = std::vector<OutputLevel>;

struct Identify {
  friend bool operator==(const Identify&, const Identify&) = default;
};
struct Show {
  OutputPattern pattern;
  friend bool operator==(const Show&, const Show&) = default;
};
// A part of a sequence: all its patterns, encoded one after the other (encode_patterns), cut anywhere.
struct Load {
  std::uint32_t patterns = 0;     // in the whole sequence
  std::uint32_t total_bytes = 0;  // of the whole sequence
  std::uint32_t crc = 0;          // CRC-32C of the whole sequence
  std::uint32_t offset = 0;       // where `bytes` belong
  std::vector<std::uint8_t> bytes;
  friend bool operator==(const Load&, const Load&) = default;
};
enum class StepSource : std::uint8_t { kCommand = 0, kStrobe = 1 };
enum class StrobeEdge : std::uint8_t { kRising = 0, kFalling = 1 };
struct Arm {
  std::uint32_t first = 0;  // pattern that is lit at once
  StepSource source = StepSource::kCommand;
  StrobeEdge edge = StrobeEdge::kFalling;
  std::uint16_t delay = 0;  // from the strobe's edge to the step, in units of 10 us
  friend bool operator==(const Arm&, const Arm&) = default;
};
struct StepOn {
  friend bool operator==(const StepOn&, const StepOn&) = default;
};
struct AskStatus {
  friend bool operator==(const AskStatus&, const AskStatus&) = default;
};
struct Off {
  friend bool operator==(const Off&, const Off&) = default;
};
struct KeepAlive {
  friend bool operator==(const KeepAlive&, const KeepAlive&) = default;
};

// ---- what the controller sends

enum class LedState : std::uint8_t { kDark = 0, kShowing = 1, kArmed = 2 };

// Bits of `faults`. Set ones stay until OFF or IDENTIFY.
enum LedFault : std::uint32_t {
  kFaultHostSilent = 1u << 0,
  kFaultOnTime = 1u << 1,
  kFaultDuty = 1u << 2,
  kFaultTemperature = 1u << 3,
  kFaultFlashing = 1u << 4,
};

constexpr std::uint32_t kNoPosition = 0xFFFFFFFF;  // not armed

struct Ack {
  LedMessageType command = LedMessageType::kKeepAlive;  // that was obeyed
  LedState state = LedState::kDark;
  std::uint16_t lit = 0;                 // outputs that are on
  std::uint32_t position = kNoPosition;  // index of the pattern that is lit; the number of patterns after the last
  std::uint32_t faults = 0;
  friend bool operator==(const Ack&, const Ack&) = default;
};
enum class NakReason : std::uint8_t {
  kUnknownType = 1,
  kBadPayload = 2,   // the payload is not one of this type
  kBadSequence = 3,  // older than the last, or the last one's with other content
  kBadOutput = 4,    // detail: the output
  kTooLarge = 5,     // more patterns or bytes than fit; detail: how many do
  kBadOffset = 6,    // LOAD: detail: the offset that is expected
  kBadChecksum = 7,  // LOAD: all is there and it is not what was promised
  kNotLoaded = 8,    // ARM without a whole sequence
  kBadIndex = 9,     // ARM; detail: how many patterns there are
  kNotArmed = 10,    // STEP while not armed for steps by command
  kPastEnd = 11,     // STEP after the last pattern
  kFault = 12,       // a fault is set that only OFF or IDENTIFY clears
  kResting = 13,     // duty limit; detail: the output
};
struct Nak {
  LedMessageType command = LedMessageType::kKeepAlive;  // that was refused: nothing has changed
  NakReason reason = NakReason::kUnknownType;
  std::uint32_t detail = 0;
  std::uint32_t faults = 0;
  friend bool operator==(const Nak&, const Nak&) = default;
};
struct Identity {
  std::uint16_t protocol = kLedProtocolVersion;
  std::uint16_t firmware_major = 0, firmware_minor = 0;
  std::uint16_t outputs = 0;
  std::uint8_t colours = 3;             // of an output: 1 or 3
  std::uint16_t duty_per_mille = 1000;  // see docs/led-protocol.md, limits; 1000: no limit
  std::uint32_t duty_window_ms = 0;
  std::uint32_t on_time_limit_ms = 0;  // 0: none
  std::uint32_t max_payload = 0;       // bytes
  std::uint32_t max_patterns = 0;      // 0: holds no sequences
  std::uint32_t max_sequence_bytes = 0;
  std::int16_t temperature_limit_tenths = 0;
  std::string serial;  // up to 28 printable ASCII characters
  friend bool operator==(const Identity&, const Identity&) = default;
};
constexpr std::int16_t kNotMeasured = -32768;  // StatusReport::temperature_tenths
// Answers STATUS, and comes by itself (sequence 0) when a fault is set.
struct StatusReport {
  std::int16_t temperature_tenths = kNotMeasured;  // 0.1 degrees Celsius, hottest place
  std::uint16_t lit = 0;
  std::uint32_t supply_millivolts = 0;  // 0: not measured
  std::uint32_t faults = 0;
  std::uint32_t patterns = 0;  // loaded, whole and checked
  std::uint32_t position = kNoPosition;
  std::uint32_t steps = 0;    // since power came on
  std::uint64_t time_us = 0;  // since power came on
  LedState state = LedState::kDark;
  friend bool operator==(const StatusReport&, const StatusReport&) = default;
};
// Comes by itself (sequence 0) at every step by strobe.
struct Stepped {
  std::uint32_t position = 0;  // that is lit now; the number of patterns: all off
  std::uint32_t steps = 0;     // since power came on
  std::uint64_t time_us = 0;   // of the step, since power came on
  friend bool operator==(const Stepped&, const Stepped&) = default;
};

using LedMessage = std::variant<Identify, Show, Load, Arm, StepOn, AskStatus, Off, KeepAlive, Ack, Nak, Identity,
                                StatusReport, Stepped>;
LedMessageType type_of(const LedMessage& message);

// A message whose header and checksum are good; of any type, also one that this program does not know.
struct LedFrame {
  std::uint8_t type = 0;
  std::uint32_t sequence = 0;
  std::vector<std::uint8_t> payload;
  friend bool operator==(const LedFrame&, const LedFrame&) = default;
};

// The message as it travels. Its payload must not exceed kMaxLedPayload.
std::vector<std::uint8_t> encode(const LedMessage& message, std::uint32_t sequence);
// Nothing where the payload is not exactly one of its type: length, values that have no meaning, outputs out of order.
std::optional<LedMessage> decode(const LedFrame& frame);

// A whole sequence as LOAD carries it, and back: nothing where it is not exactly `count` patterns.
std::vector<std::uint8_t> encode_patterns(std::span<const OutputPattern> patterns);
std::optional<std::vector<OutputPattern>> decode_patterns(std::span<const std::uint8_t> bytes, std::size_t count);

// Finds messages in a stream of bytes. Where a message cannot begin or its checksum is wrong, one byte is skipped and the
// search goes on, so that a good message after garbage is found. Holds at most kMaxLedMessage bytes between calls of
// next() that return nothing.
class MessageReader {
 public:
  void feed(std::span<const std::uint8_t> bytes) { buffer_.insert(buffer_.end(), bytes.begin(), bytes.end()); }
  // The next whole message; nothing when more bytes are needed.
  std::optional<LedFrame> next();
  // True while bytes wait for the rest of their message.
  bool partial() const { return !buffer_.empty(); }
  // The rest is not coming: skips one byte, as after garbage. Call next() again, and this until partial() is false.
  void give_up_partial();

 private:
  std::vector<std::uint8_t> buffer_;
};

}  // namespace lightstage::capture
