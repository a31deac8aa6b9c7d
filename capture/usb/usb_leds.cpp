#include "capture/usb_leds.h"

#include "capture/protocol_leds.h"
#include "capture/usb/dmx_leds.h"
#include "capture/usb/usb_link.h"

namespace lightstage::capture {

namespace {

std::string named(const std::string& kind, const std::string& serial) {
  return serial.empty() ? kind : kind + " '" + serial + "'";
}

// FTDI's requests, as its drivers make them. The widget's own processor sets the speed of its serial side, so that a rate is
// of no consequence, but some chips send nothing before they were given one.
void set_up_ftdi(UsbDevice& device) {
  enum Request : std::uint8_t { kReset = 0, kFlowControl = 2, kBaudRate = 3, kData = 4, kLatencyTimer = 9 };
  constexpr std::uint16_t kResetAll = 0, kPurgeReceived = 1, kPurgeToSend = 2;
  constexpr std::uint16_t kDivisor57600 = 0x0034, kEightBits = 8, kOneMillisecond = 1;
  device.vendor_request(kReset, kResetAll);
  device.vendor_request(kLatencyTimer, kOneMillisecond);  // 16 ms otherwise, before a short answer is sent
  device.vendor_request(kFlowControl, 0);
  device.vendor_request(kBaudRate, kDivisor57600);
  device.vendor_request(kData, kEightBits);
  device.vendor_request(kReset, kPurgeReceived);
  device.vendor_request(kReset, kPurgeToSend);
}

// What the widget itself sends and hears.
class FtdiLink : public LedLink {
 public:
  FtdiLink(const std::string& serial, core::Clock& clock)
      : usb_(ControllerKind::kEnttecDmxUsbPro, serial, clock, set_up_ftdi), clock_(clock) {}

  void write(std::span<const std::uint8_t> bytes, core::Nanoseconds deadline) override { usb_.write(bytes, deadline); }

  std::vector<std::uint8_t> read(core::Nanoseconds deadline) override {
    while (true) {
      const std::vector<std::uint8_t> transfer = usb_.read(deadline);
      std::vector<std::uint8_t> data = without_ftdi_status(transfer, usb_.packet_bytes());
      if (!data.empty() || clock_.now() >= deadline) return data;
    }
  }

 private:
  UsbLink usb_;
  core::Clock& clock_;
};

}  // namespace

std::unique_ptr<LedController> open_usb_leds(const std::string& serial, std::vector<int> output_of_light,
                                             core::Clock& clock) {
  return std::make_unique<ProtocolLeds>(
      std::make_unique<UsbLink>(ControllerKind::kLightstage, serial, clock),
      ProtocolLedsOptions{named("LED controller", serial), std::move(output_of_light), true}, clock);
}

std::unique_ptr<LedController> open_dmx_widget(const std::string& serial,
                                               std::vector<std::vector<int>> channels_of_light, core::Clock& clock,
                                               const std::vector<std::string>& lights_off_command) {
  std::unique_ptr<LightsOffOnDeath> guard;
  if (!lights_off_command.empty()) guard = std::make_unique<LightsOffOnDeath>(lights_off_command);
  return std::make_unique<DmxLeds>(std::make_unique<FtdiLink>(serial, clock),
                                   DmxLedsOptions{named("DMX widget", serial), std::move(channels_of_light)}, clock,
                                   std::move(guard));
}

void usb_lights_off(ControllerKind kind, const std::string& serial, core::Clock& clock) {
  if (kind == ControllerKind::kLightstage) {
    open_usb_leds(serial, {}, clock)->all_off();
  } else {
    open_dmx_widget(serial, {}, clock)->all_off();
  }
}

std::vector<UsbLedsSeen> usb_leds_seen() {
  return find_usb_leds();
}

}  // namespace lightstage::capture
