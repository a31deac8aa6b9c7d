#include "capture/led_protocol.h"

#include <algorithm>
#include <array>

namespace lightstage::capture {

namespace {

constexpr std::size_t kLengthAt = 8, kCrcAt = 12, kSerialBytes = 28;
constexpr std::size_t kLoadHeadBytes = 16, kPatternHeadBytes = 4, kLevelBytes = 8;

constexpr std::array<std::uint32_t, 256> make_crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0x82F63B78u : 0u);
    table[i] = crc;
  }
  return table;
}
constexpr std::array<std::uint32_t, 256> kCrcTable = make_crc_table();

class Writer {
 public:
  explicit Writer(std::vector<std::uint8_t>& bytes) : bytes_(bytes) {}
  void u8(std::uint8_t v) { bytes_.push_back(v); }
  void u16(std::uint16_t v) { little_endian(v, 2); }
  void u32(std::uint32_t v) { little_endian(v, 4); }
  void u64(std::uint64_t v) { little_endian(v, 8); }
  void zeros(std::size_t count) { bytes_.insert(bytes_.end(), count, 0); }
  void raw(std::span<const std::uint8_t> v) { bytes_.insert(bytes_.end(), v.begin(), v.end()); }

 private:
  void little_endian(std::uint64_t v, int count) {
    for (int i = 0; i < count; ++i) bytes_.push_back(static_cast<std::uint8_t>(v >> (8 * i)));
  }
  std::vector<std::uint8_t>& bytes_;
};

// Gives zeros past the end and remembers that it did.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  std::uint8_t u8() { return static_cast<std::uint8_t>(little_endian(1)); }
  std::uint16_t u16() { return static_cast<std::uint16_t>(little_endian(2)); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(little_endian(4)); }
  std::uint64_t u64() { return little_endian(8); }
  // Fields that are written as zero and whose later meaning a reader of today may ignore.
  void reserved(std::size_t count) { take(count); }
  std::span<const std::uint8_t> take(std::size_t count) {
    if (count > bytes_.size()) {
      good_ = false;
      return {};
    }
    const auto taken = bytes_.first(count);
    bytes_ = bytes_.subspan(count);
    return taken;
  }
  std::size_t left() const { return bytes_.size(); }
  bool good() const { return good_; }
  bool finished() const { return good_ && bytes_.empty(); }

 private:
  std::uint64_t little_endian(std::size_t count) {
    std::uint64_t v = 0;
    const auto bytes = take(count);
    for (std::size_t i = 0; i < bytes.size(); ++i) v |= std::uint64_t(bytes[i]) << (8 * i);
    return v;
  }
  std::span<const std::uint8_t> bytes_;
  bool good_ = true;
};

std::uint32_t message_crc(std::span<const std::uint8_t> message) {
  return crc32c(message.subspan(kLedHeaderBytes), crc32c(message.first(kCrcAt)));
}

std::uint32_t u32_at(std::span<const std::uint8_t> bytes, std::size_t at) {
  return Reader(bytes.subspan(at, 4)).u32();
}

// ---- payloads, one pair of functions for each type that has one

void write_pattern(Writer& w, const OutputPattern& pattern) {
  w.u16(static_cast<std::uint16_t>(pattern.size()));
  w.u16(0);
  for (const OutputLevel& level : pattern) {
    for (const std::uint16_t v : {level.output, level.r, level.g, level.b}) w.u16(v);
  }
}

std::optional<OutputPattern> read_pattern(Reader& r) {
  const std::size_t count = r.u16();
  r.reserved(2);
  if (!r.good() || count > kMaxLedOutputs || count * kLevelBytes > r.left()) return std::nullopt;
  OutputPattern pattern(count);
  for (std::size_t i = 0; i < count; ++i) {
    OutputLevel& level = pattern[i];
    for (std::uint16_t* v : {&level.output, &level.r, &level.g, &level.b}) *v = r.u16();
    if (level.output >= kMaxLedOutputs || (i > 0 && level.output <= pattern[i - 1].output)) return std::nullopt;
  }
  return pattern;
}

struct WritePayload {
  Writer& w;
  void operator()(const Identify&) const {}
  void operator()(const StepOn&) const {}
  void operator()(const AskStatus&) const {}
  void operator()(const Off&) const {}
  void operator()(const KeepAlive&) const {}
  void operator()(const Show& m) const { write_pattern(w, m.pattern); }
  void operator()(const Load& m) const {
    for (const std::uint32_t v : {m.patterns, m.total_bytes, m.crc, m.offset}) w.u32(v);
    w.raw(m.bytes);
  }
  void operator()(const Arm& m) const {
    w.u32(m.first);
    w.u8(static_cast<std::uint8_t>(m.source));
    w.u8(static_cast<std::uint8_t>(m.edge));
    w.u16(m.delay);
  }
  void operator()(const Ack& m) const {
    w.u8(static_cast<std::uint8_t>(m.command));
    w.u8(static_cast<std::uint8_t>(m.state));
    w.u16(m.lit);
    w.u32(m.position);
    w.u32(m.faults);
  }
  void operator()(const Nak& m) const {
    w.u8(static_cast<std::uint8_t>(m.command));
    w.u8(static_cast<std::uint8_t>(m.reason));
    w.zeros(2);
    w.u32(m.detail);
    w.u32(m.faults);
  }
  void operator()(const Identity& m) const {
    for (const std::uint16_t v : {m.protocol, m.firmware_major, m.firmware_minor, m.outputs}) w.u16(v);
    w.u8(m.colours);
    w.zeros(1);
    w.u16(m.duty_per_mille);
    for (const std::uint32_t v :
         {m.duty_window_ms, m.on_time_limit_ms, m.max_payload, m.max_patterns, m.max_sequence_bytes}) {
      w.u32(v);
    }
    w.u16(static_cast<std::uint16_t>(m.temperature_limit_tenths));
    w.zeros(2);
    std::array<std::uint8_t, kSerialBytes> serial{};
    std::copy_n(m.serial.begin(), std::min(m.serial.size(), kSerialBytes), serial.begin());
    w.raw(serial);
  }
  void operator()(const StatusReport& m) const {
    w.u16(static_cast<std::uint16_t>(m.temperature_tenths));
    w.u16(m.lit);
    for (const std::uint32_t v : {m.supply_millivolts, m.faults, m.patterns, m.position, m.steps}) w.u32(v);
    w.u64(m.time_us);
    w.u8(static_cast<std::uint8_t>(m.state));
    w.zeros(3);
  }
  void operator()(const Stepped& m) const {
    w.u32(m.position);
    w.u32(m.steps);
    w.u64(m.time_us);
  }
};

std::optional<LedMessage> read_show(Reader& r) {
  std::optional<OutputPattern> pattern = read_pattern(r);
  if (!pattern) return std::nullopt;
  return Show{std::move(*pattern)};
}

std::optional<LedMessage> read_load(Reader& r) {
  Load m;
  for (std::uint32_t* v : {&m.patterns, &m.total_bytes, &m.crc, &m.offset}) *v = r.u32();
  const auto bytes = r.take(r.left());
  if (bytes.empty() || m.offset > m.total_bytes || bytes.size() > m.total_bytes - m.offset) return std::nullopt;
  m.bytes.assign(bytes.begin(), bytes.end());
  return m;
}

std::optional<LedMessage> read_arm(Reader& r) {
  Arm m;
  m.first = r.u32();
  m.source = static_cast<StepSource>(r.u8());
  m.edge = static_cast<StrobeEdge>(r.u8());
  m.delay = r.u16();
  if (m.source > StepSource::kStrobe || m.edge > StrobeEdge::kFalling) return std::nullopt;
  return m;
}

std::optional<LedMessage> read_ack(Reader& r) {
  Ack m;
  m.command = static_cast<LedMessageType>(r.u8());
  m.state = static_cast<LedState>(r.u8());
  m.lit = r.u16();
  m.position = r.u32();
  m.faults = r.u32();
  if (m.state > LedState::kArmed) return std::nullopt;
  return m;
}

std::optional<LedMessage> read_nak(Reader& r) {
  Nak m;
  m.command = static_cast<LedMessageType>(r.u8());
  m.reason = static_cast<NakReason>(r.u8());
  r.reserved(2);
  m.detail = r.u32();
  m.faults = r.u32();
  return m;  // with a reason that is not known, it still is a refusal
}

std::optional<LedMessage> read_identity(Reader& r) {
  Identity m;
  for (std::uint16_t* v : {&m.protocol, &m.firmware_major, &m.firmware_minor, &m.outputs}) *v = r.u16();
  m.colours = r.u8();
  r.reserved(1);
  m.duty_per_mille = r.u16();
  for (std::uint32_t* v :
       {&m.duty_window_ms, &m.on_time_limit_ms, &m.max_payload, &m.max_patterns, &m.max_sequence_bytes}) {
    *v = r.u32();
  }
  m.temperature_limit_tenths = static_cast<std::int16_t>(r.u16());
  r.reserved(2);
  const auto serial = r.take(kSerialBytes);
  const auto end = std::find(serial.begin(), serial.end(), 0);
  const auto printable = [](std::uint8_t c) { return c > 0x20 && c < 0x7F; };
  const auto zero = [](std::uint8_t c) { return c == 0; };
  if (!std::all_of(serial.begin(), end, printable) || !std::all_of(end, serial.end(), zero)) return std::nullopt;
  m.serial.assign(serial.begin(), end);
  if ((m.colours != 1 && m.colours != 3) || m.outputs > kMaxLedOutputs || m.duty_per_mille > 1000) return std::nullopt;
  return m;
}

std::optional<LedMessage> read_status(Reader& r) {
  StatusReport m;
  m.temperature_tenths = static_cast<std::int16_t>(r.u16());
  m.lit = r.u16();
  for (std::uint32_t* v : {&m.supply_millivolts, &m.faults, &m.patterns, &m.position, &m.steps}) *v = r.u32();
  m.time_us = r.u64();
  m.state = static_cast<LedState>(r.u8());
  r.reserved(3);
  if (m.state > LedState::kArmed) return std::nullopt;
  return m;
}

std::optional<LedMessage> read_stepped(Reader& r) {
  Stepped m;
  m.position = r.u32();
  m.steps = r.u32();
  m.time_us = r.u64();
  return m;
}

std::optional<LedMessage> read_payload(LedMessageType type, Reader& r) {
  switch (type) {
    case LedMessageType::kIdentify:
      return Identify{};
    case LedMessageType::kShow:
      return read_show(r);
    case LedMessageType::kLoad:
      return read_load(r);
    case LedMessageType::kArm:
      return read_arm(r);
    case LedMessageType::kStep:
      return StepOn{};
    case LedMessageType::kStatus:
      return AskStatus{};
    case LedMessageType::kOff:
      return Off{};
    case LedMessageType::kKeepAlive:
      return KeepAlive{};
    case LedMessageType::kAck:
      return read_ack(r);
    case LedMessageType::kNak:
      return read_nak(r);
    case LedMessageType::kIdentity:
      return read_identity(r);
    case LedMessageType::kStatusReport:
      return read_status(r);
    case LedMessageType::kStepped:
      return read_stepped(r);
  }
  return std::nullopt;
}

}  // namespace

std::string_view to_string(LedMessageType type) {
  switch (type) {
    case LedMessageType::kIdentify:
      return "IDENTIFY";
    case LedMessageType::kShow:
      return "SHOW";
    case LedMessageType::kLoad:
      return "LOAD";
    case LedMessageType::kArm:
      return "ARM";
    case LedMessageType::kStep:
      return "STEP";
    case LedMessageType::kStatus:
      return "STATUS";
    case LedMessageType::kOff:
      return "OFF";
    case LedMessageType::kKeepAlive:
      return "KEEP_ALIVE";
    case LedMessageType::kAck:
      return "ACK";
    case LedMessageType::kNak:
      return "NAK";
    case LedMessageType::kIdentity:
      return "IDENTITY";
    case LedMessageType::kStatusReport:
      return "STATUS_REPORT";
    case LedMessageType::kStepped:
      return "STEPPED";
  }
  return "unknown";
}

std::uint32_t crc32c(std::span<const std::uint8_t> bytes, std::uint32_t before) {
  std::uint32_t crc = ~before;
  for (const std::uint8_t byte : bytes) crc = (crc >> 8) ^ kCrcTable[(crc ^ byte) & 0xFF];
  return ~crc;
}

LedMessageType type_of(const LedMessage& message) {
  constexpr std::array kTypes{LedMessageType::kIdentify, LedMessageType::kShow,      LedMessageType::kLoad,
                              LedMessageType::kArm,      LedMessageType::kStep,      LedMessageType::kStatus,
                              LedMessageType::kOff,      LedMessageType::kKeepAlive, LedMessageType::kAck,
                              LedMessageType::kNak,      LedMessageType::kIdentity,  LedMessageType::kStatusReport,
                              LedMessageType::kStepped};
  static_assert(kTypes.size() == std::variant_size_v<LedMessage>);
  return kTypes[message.index()];
}

std::vector<std::uint8_t> encode(const LedMessage& message, std::uint32_t sequence) {
  std::vector<std::uint8_t> bytes;
  Writer w(bytes);
  w.u8('L');
  w.u8('S');
  w.u8(kLedProtocolVersion);
  w.u8(static_cast<std::uint8_t>(type_of(message)));
  w.u32(sequence);
  w.zeros(8);
  std::visit(WritePayload{w}, message);

  const auto put = [&bytes](std::size_t at, std::size_t value) {
    for (std::size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
  };
  put(kLengthAt, bytes.size() - kLedHeaderBytes);
  put(kCrcAt, message_crc(bytes));
  return bytes;
}

std::optional<LedMessage> decode(const LedFrame& frame) {
  Reader r(frame.payload);
  std::optional<LedMessage> message = read_payload(static_cast<LedMessageType>(frame.type), r);
  if (!r.finished()) return std::nullopt;
  return message;
}

std::vector<std::uint8_t> encode_patterns(std::span<const OutputPattern> patterns) {
  std::vector<std::uint8_t> bytes;
  Writer w(bytes);
  for (const OutputPattern& pattern : patterns) write_pattern(w, pattern);
  return bytes;
}

std::optional<std::vector<OutputPattern>> decode_patterns(std::span<const std::uint8_t> bytes, std::size_t count) {
  if (count > bytes.size() / kPatternHeadBytes) return std::nullopt;
  Reader r(bytes);
  std::vector<OutputPattern> patterns;
  patterns.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    std::optional<OutputPattern> pattern = read_pattern(r);
    if (!pattern) return std::nullopt;
    patterns.push_back(std::move(*pattern));
  }
  if (!r.finished()) return std::nullopt;
  return patterns;
}

std::optional<LedFrame> MessageReader::next() {
  const std::span<const std::uint8_t> all(buffer_);
  // Where the stream may hold a message, as far as its header is there.
  const auto may_begin = [](std::span<const std::uint8_t> rest) {
    constexpr std::array<std::uint8_t, 3> kBegin{'L', 'S', kLedProtocolVersion};
    if (!std::equal(kBegin.begin(), kBegin.begin() + std::ptrdiff_t(std::min(rest.size(), kBegin.size())),
                    rest.begin()))
      return false;
    return rest.size() < kLengthAt + 4 || u32_at(rest, kLengthAt) <= kMaxLedPayload;
  };
  const auto consume = [this](std::size_t count) {
    buffer_.erase(buffer_.begin(), buffer_.begin() + std::ptrdiff_t(count));
  };

  for (std::size_t at = 0; at < all.size(); ++at) {
    const auto rest = all.subspan(at);
    if (!may_begin(rest)) continue;
    const std::size_t needed =
        rest.size() < kLedHeaderBytes ? kLedHeaderBytes : kLedHeaderBytes + u32_at(rest, kLengthAt);
    if (rest.size() < needed) {
      consume(at);
      return std::nullopt;
    }
    const auto message = rest.first(needed);
    if (message_crc(message) != u32_at(message, kCrcAt)) continue;
    LedFrame frame{message[3], u32_at(message, 4), {message.begin() + kLedHeaderBytes, message.end()}};
    consume(at + needed);
    return frame;
  }
  buffer_.clear();
  return std::nullopt;
}

void MessageReader::give_up_partial() {
  if (!buffer_.empty()) buffer_.erase(buffer_.begin());
}

}  // namespace lightstage::capture
