#include "capture/preview/tev_packets.h"

#include <bit>
#include <concepts>
#include <cstdint>

namespace lightstage::capture {

namespace {

constexpr std::uint8_t kCreateImage = 4, kUpdateImageV3 = 6;
constexpr std::size_t kLengthBytes = 4;

class Packet {
 public:
  explicit Packet(std::uint8_t operation) : bytes_(kLengthBytes, '\0') {
    put(operation);
    put(std::uint8_t{0});  // grab focus
  }

  void put(std::integral auto value) {
    auto bits = static_cast<std::uint64_t>(value);
    for (std::size_t i = 0; i < sizeof value; ++i, bits >>= 8) bytes_.push_back(static_cast<char>(bits & 0xff));
  }
  void put(const std::string& text) { bytes_.append(text.c_str(), text.size() + 1); }
  void put(std::span<const float> values) {
    bytes_.reserve(bytes_.size() + values.size_bytes());
    for (const float v : values) put(std::bit_cast<std::uint32_t>(v));
  }

  std::string finish() {
    auto length = static_cast<std::uint32_t>(bytes_.size());
    for (std::size_t i = 0; i < kLengthBytes; ++i, length >>= 8) bytes_[i] = static_cast<char>(length & 0xff);
    return std::move(bytes_);
  }

 private:
  std::string bytes_;
};

void put_channels(Packet& packet, int channels) {
  packet.put(static_cast<std::int32_t>(channels));
  const std::vector<std::string> names =
      channels == 1 ? std::vector<std::string>{"Y"} : std::vector<std::string>{"R", "G", "B"};
  for (const std::string& name : names) packet.put(name);
}

}  // namespace

std::string tev_create_packet(const std::string& name, core::ImageSize size) {
  Packet packet(kCreateImage);
  packet.put(name);
  packet.put(static_cast<std::int32_t>(size.width));
  packet.put(static_cast<std::int32_t>(size.height));
  put_channels(packet, size.channels);
  return packet.finish();
}

std::string tev_update_packet(const std::string& name, const core::Image& image) {
  Packet packet(kUpdateImageV3);
  packet.put(name);
  put_channels(packet, image.channels());
  for (const int v : {0, 0, image.width(), image.height()}) packet.put(static_cast<std::int32_t>(v));
  for (int c = 0; c < image.channels(); ++c) packet.put(static_cast<std::int64_t>(c));
  for (int c = 0; c < image.channels(); ++c) packet.put(static_cast<std::int64_t>(image.channels()));
  packet.put(image.values());
  return packet.finish();
}

}  // namespace lightstage::capture
