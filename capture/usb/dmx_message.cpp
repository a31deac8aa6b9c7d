#include "capture/usb/dmx_message.h"

#include <algorithm>

namespace lightstage::capture {

namespace {

constexpr std::uint8_t kBegin = 0x7E, kEnd = 0xE7;
constexpr std::size_t kHeadBytes = 4;
constexpr std::size_t kFtdiStatusBytes = 2;
constexpr core::Nanoseconds kTimingUnit = 10'670, kSlot = 44'000;

}  // namespace

std::vector<std::uint8_t> encode(const DmxMessage& message) {
  const std::size_t length = message.data.size();
  std::vector<std::uint8_t> bytes{kBegin, message.label, std::uint8_t(length), std::uint8_t(length >> 8)};
  bytes.insert(bytes.end(), message.data.begin(), message.data.end());
  bytes.push_back(kEnd);
  return bytes;
}

std::optional<DmxMessage> DmxReader::next() {
  const std::span<const std::uint8_t> all(buffer_);
  const auto consume = [this](std::size_t count) {
    buffer_.erase(buffer_.begin(), buffer_.begin() + std::ptrdiff_t(count));
  };
  for (std::size_t at = 0; at < all.size(); ++at) {
    const auto rest = all.subspan(at);
    if (rest[0] != kBegin) continue;
    const std::size_t length = rest.size() < kHeadBytes ? 0 : std::size_t(rest[2]) | std::size_t(rest[3]) << 8;
    if (length > kMaxDmxData) continue;
    if (rest.size() < kHeadBytes + length + 1) {
      consume(at);
      return std::nullopt;
    }
    if (rest[kHeadBytes + length] != kEnd) continue;
    const auto data = rest.subspan(kHeadBytes, length);
    DmxMessage message{rest[1], {data.begin(), data.end()}};
    consume(at + kHeadBytes + length + 1);
    return message;
  }
  buffer_.clear();
  return std::nullopt;
}

void DmxReader::give_up_partial() {
  if (!buffer_.empty()) buffer_.erase(buffer_.begin());
}

std::optional<DmxParameters> decode_parameters(const DmxMessage& message) {
  constexpr std::size_t kFixedBytes = 5;  // what follows is the user's
  constexpr int kFastest = 40;
  const std::vector<std::uint8_t>& data = message.data;
  if (message.label != std::uint8_t(DmxLabel::kParameters) || data.size() < kFixedBytes || data[4] > kFastest) {
    return std::nullopt;
  }
  return DmxParameters{std::uint16_t(data[0] | data[1] << 8), data[2] * kTimingUnit, data[3] * kTimingUnit, data[4]};
}

DmxMessage dmx_frame(std::span<const std::uint8_t> channels) {
  DmxMessage message{std::uint8_t(DmxLabel::kSendDmx), {0}};
  message.data.insert(message.data.end(), channels.begin(), channels.end());
  message.data.resize(1 + std::max(channels.size(), kMinDmxChannels));
  return message;
}

core::Nanoseconds dmx_settling(std::size_t channels, const DmxParameters& parameters) {
  const core::Nanoseconds break_time = std::max(parameters.break_time, DmxParameters{}.break_time);
  const core::Nanoseconds mark_time = std::max(parameters.mark_time, DmxParameters{}.mark_time);
  const auto slots = static_cast<core::Nanoseconds>(1 + std::max(channels, kMinDmxChannels));
  const core::Nanoseconds frame = break_time + mark_time + slots * kSlot;
  const core::Nanoseconds period = parameters.rate > 0 ? core::kSecond / parameters.rate : 0;
  return 2 * std::max(frame, period);
}

std::vector<std::uint8_t> without_ftdi_status(std::span<const std::uint8_t> transfer, std::size_t packet_bytes) {
  std::vector<std::uint8_t> data;
  for (std::size_t at = 0; at < transfer.size(); at += packet_bytes) {
    const auto packet = transfer.subspan(at, std::min(packet_bytes, transfer.size() - at));
    if (packet.size() > kFtdiStatusBytes) data.insert(data.end(), packet.begin() + kFtdiStatusBytes, packet.end());
  }
  return data;
}

}  // namespace lightstage::capture
