#include "hil/rig/dmx_widget.h"

#include <algorithm>

#include "hil/rig/now.h"

namespace lightstage::hil {

namespace {

constexpr std::uint8_t kIn = 1, kOut = 2;                   // endpoints of the FT232
constexpr std::size_t kPacketBytes = 64, kStatusBytes = 2;  // each packet to the host begins with the modem's status
constexpr Nanoseconds kLatency = 16 * kMillisecond;         // the chip's latency timer
constexpr std::uint8_t kMessageStart = 0x7e, kMessageEnd = 0xe7;
constexpr std::size_t kFrameBytes = 5;  // around a message's data
enum Label : std::uint8_t { kGetParameters = 3, kSendDmx = 6, kGetSerial = 10 };
constexpr std::size_t kMostData = 600;

}  // namespace

DmxWidget::DmxWidget(int port, Scene& scene)
    : UsbipDevice(port, {.vendor = 0x0403,
                         .product = 0x6001,
                         .manufacturer = "ENTTEC",
                         .product_name = "DMX USB PRO",
                         .serial = "DMX0",
                         .full_speed = true}),
      scene_(scene) {}

Bytes DmxWidget::configuration() const {
  return {9,    2,    32,         0,  1,
          1,    0,    0x80,       45,  // configuration
          9,    4,    0,          0,  2,
          0xff, 0xff, 0xff,       2,  // interface
          7,    5,    0x80 | kIn, 2,  kPacketBytes,
          0,    0,  // bulk in
          7,    5,    kOut,       2,  kPacketBytes,
          0,    0};  // bulk out
}

std::optional<Bytes> DmxWidget::control_in(const Setup& setup) {
  // Modem status and latency timer; the chip answers other reads (of its EEPROM) with what an empty one holds.
  if (setup.request == 5) return Bytes{0x31, 0x60};
  if (setup.request == 10) return Bytes{16};
  return Bytes(setup.length, 0xff);
}

bool DmxWidget::control_out(const Setup& setup, ByteView) {
  constexpr std::uint8_t kReset = 0;
  if (setup.request == kReset && setup.value != 2) received_.clear();
  if (setup.request == kReset && setup.value != 1) to_send_.clear();
  return true;
}

bool DmxWidget::bulk_out(std::uint8_t, ByteView data) {
  append(received_, data);
  take_messages();
  return true;
}

void DmxWidget::bulk_in_waiting(std::uint8_t) {
  answer_due_ = now() + kLatency;
  send(false);
}

std::optional<Nanoseconds> DmxWidget::next_event() const {
  return waiting(kIn) ? std::optional(answer_due_) : std::nullopt;
}

void DmxWidget::advance(Nanoseconds time) {
  send(time >= answer_due_);
}

void DmxWidget::unplugged() {
  received_.clear();
  to_send_.clear();
  show({});
}

void DmxWidget::take_messages() {
  for (;;) {
    received_.erase(received_.begin(), std::find(received_.begin(), received_.end(), kMessageStart));
    if (received_.size() < kFrameBytes) return;
    const std::size_t length = number(ByteView(received_).subspan(2), 2);
    const bool complete = received_.size() >= kFrameBytes + length;
    if (length <= kMostData && !complete) return;
    if (length <= kMostData && received_[kFrameBytes - 1 + length] == kMessageEnd) {
      const auto end = received_.begin() + static_cast<std::ptrdiff_t>(kFrameBytes + length);
      const Bytes message(received_.begin(), end);
      received_.erase(received_.begin(), end);
      handle(message[1], ByteView(message).subspan(4, length));
    } else {
      received_.erase(received_.begin());  // no message began here
    }
  }
}

void DmxWidget::handle(std::uint8_t label, ByteView data) {
  switch (label) {
    // Firmware 1.44, 9 x 10.67 us of break, 1 x 10.67 us of mark after it, 40 packets a second.
    case kGetParameters:
      return reply(label, Bytes{44, 1, 9, 1, 40});
    case kGetSerial:
      return reply(label, Bytes{0x00, 0x00, 0x00, 0x01});
    case kSendDmx:
      // The first byte is the start code; 0 means dimmer levels.
      if (data.empty() || data[0] != 0) return;
      show(data.subspan(1));
      if (on_values) on_values();
      return;
    default:
      return;
  }
}

void DmxWidget::reply(std::uint8_t label, ByteView data) {
  append(to_send_, Bytes{kMessageStart, label});
  append(to_send_, static_cast<std::uint32_t>(data.size()), 2);
  append(to_send_, data);
  to_send_.push_back(kMessageEnd);
  send(false);
}

void DmxWidget::show(ByteView values) {
  std::array<Rgb, kDmxChannels> levels{};
  for (std::size_t i = 0; i < levels.size() && i < values.size(); ++i)
    levels[i].fill(static_cast<float>(values[i]) / 255);
  scene_.set(now(), kLedOutputs, levels);
}

void DmxWidget::send(bool even_empty) {
  while (waiting(kIn) && (even_empty || !to_send_.empty())) {
    even_empty = false;
    Bytes bytes;
    for (std::size_t room = *waiting(kIn); room > kStatusBytes && (bytes.empty() || !to_send_.empty());) {
      const std::size_t count = std::min({to_send_.size(), kPacketBytes - kStatusBytes, room - kStatusBytes});
      append(bytes, Bytes{0x31, 0x60});
      append(bytes, ByteView(to_send_).first(count));
      to_send_.erase(to_send_.begin(), to_send_.begin() + static_cast<std::ptrdiff_t>(count));
      room -= count + kStatusBytes;
    }
    answer(kIn, bytes);
  }
}

}  // namespace lightstage::hil
