#include "hil/rig/led_device.h"

#include <algorithm>

#include "capture/led_protocol.h"
#include "hil/rig/now.h"

namespace lightstage::hil {

namespace {

constexpr std::uint8_t kIn = 1, kOut = 2;  // endpoint numbers are the maker's choice

std::string serial_number(int port) {
  return "LED" + std::to_string(port);
}

sim::LedFirmwareOptions options(int port) {
  sim::LedFirmwareOptions options;
  options.identity.outputs = kLedOutputs;
  options.identity.serial = serial_number(port);
  return options;
}

std::array<Rgb, kLedOutputs> levels(std::span<const capture::OutputLevel> lit) {
  std::array<Rgb, kLedOutputs> levels{};
  for (const capture::OutputLevel& l : lit) levels[l.output] = {l.r / 65535.0f, l.g / 65535.0f, l.b / 65535.0f};
  return levels;
}

}  // namespace

LedDevice::LedDevice(int port, Scene& scene)
    : UsbipDevice(port, {.vendor = 0x1209,
                         .product = 0x0001,
                         .manufacturer = "Lightstage",
                         .product_name = "Emulated LED controller",
                         .serial = serial_number(port)}),
      port_(port),
      scene_(scene) {
  power_cycle();
}

void LedDevice::power_cycle() {
  power_on_ = now();
  scene_.set(power_on_, 0, levels({}));
  firmware_.emplace(options(port_), [this](core::Nanoseconds time, std::span<const capture::OutputLevel> lit) {
    scene_.set(power_on_ + time, 0, levels(lit));
  });
  firmware_->set_temperature(31, 0);
  firmware_->set_supply_volts(24);
}

Bytes LedDevice::configuration() const {
  return {9,
          2,
          32,
          0,
          1,
          1,
          0,
          0x80,
          50,  // configuration
          9,
          4,
          0,
          0,
          2,
          capture::kLedUsbClass,
          capture::kLedUsbSubclass,
          capture::kLedUsbProtocol,
          0,
          7,
          5,
          kOut,
          2,
          0x00,
          0x02,
          0,  // bulk out, 512 bytes a packet
          7,
          5,
          0x80 | kIn,
          2,
          0x00,
          0x02,
          0};  // bulk in
}

bool LedDevice::bulk_out(std::uint8_t, ByteView data) {
  if (on_request) on_request();
  if (!plugged()) return false;  // a fault unplugged it
  if (stall_ > 0) return --stall_, false;
  if (mute_ > 0) return --mute_, true;
  firmware_->receive(data, since_power_on(now()));
  send();
  return true;
}

void LedDevice::strobe(bool rising, Nanoseconds time) {
  firmware_->strobe_edge(rising, since_power_on(time));
  send();
}

std::optional<Nanoseconds> LedDevice::next_event() const {
  const std::optional<core::Nanoseconds> next = firmware_->next_event();
  return next ? std::optional(power_on_ + *next) : std::nullopt;
}

void LedDevice::advance(Nanoseconds time) {
  firmware_->tick(since_power_on(time));
  send();
}

void LedDevice::unplugged() {
  to_send_.clear();
  firmware_->disconnect(since_power_on(now()));
}

void LedDevice::send() {
  const Bytes more = firmware_->take_output();
  if (!plugged()) return;
  append(to_send_, more);
  while (!to_send_.empty()) {
    const std::optional<std::size_t> room = waiting(kIn);
    if (!room) return;
    const std::size_t count = std::min(*room, to_send_.size());
    answer(kIn, ByteView(to_send_).first(count));
    to_send_.erase(to_send_.begin(), to_send_.begin() + static_cast<std::ptrdiff_t>(count));
  }
}

}  // namespace lightstage::hil
