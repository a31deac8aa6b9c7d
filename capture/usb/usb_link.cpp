#include "capture/usb/usb_link.h"

#include <algorithm>

#include "core/error.h"

namespace lightstage::capture {

namespace {
constexpr core::Nanoseconds kReplugPatience = 3 * core::kSecond, kReplugPoll = 50 * core::kMillisecond;
}

UsbLink::UsbLink(ControllerKind kind, std::string serial, core::Clock& clock, OnOpen on_open)
    : kind_(kind), serial_(std::move(serial)), clock_(clock), on_open_(std::move(on_open)) {}

UsbDevice& UsbLink::device() {
  while (!device_) {
    try {
      auto opened = std::make_unique<UsbDevice>(kind_, serial_);
      if (on_open_) on_open_(*opened);
      serial_ = opened->serial();
      packet_bytes_ = opened->packet_bytes();
      device_ = std::move(opened);
    } catch (const core::DeviceError&) {
      // A device that is coming back may not be permitted yet, or be pulled out again.
      if (clock_.now() >= wait_until_) throw;
      clock_.sleep_until(clock_.now() + kReplugPoll);
    }
  }
  return *device_;
}

template <class Action>
auto UsbLink::attempt(const Action& action) {
  UsbDevice& opened = device();
  try {
    return action(opened);
  } catch (...) {
    device_.reset();
    wait_until_ = clock_.now() + kReplugPatience;
    throw;
  }
}

// At least 1: libusb takes 0 for ever.
int UsbLink::milliseconds_until(core::Nanoseconds deadline) const {
  const core::Nanoseconds left = std::clamp<core::Nanoseconds>(deadline - clock_.now(), 1, core::kSecond);
  return static_cast<int>((left + core::kMillisecond - 1) / core::kMillisecond);
}

void UsbLink::write(std::span<const std::uint8_t> bytes, core::Nanoseconds deadline) {
  attempt([&](UsbDevice& opened) { opened.write(bytes, milliseconds_until(deadline)); });
}

std::vector<std::uint8_t> UsbLink::read(core::Nanoseconds deadline) {
  while (true) {
    std::vector<std::uint8_t> bytes =
        attempt([&](UsbDevice& opened) { return opened.read(milliseconds_until(deadline)); });
    if (!bytes.empty() || clock_.now() >= deadline) return bytes;
  }
}

}  // namespace lightstage::capture
