#include "hil/scenarios/functionfs_led.h"

#include <endian.h>
#include <fcntl.h>
#include <linux/usb/functionfs.h>
#include <sys/mount.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "capture/led_protocol.h"

namespace lightstage::hil {

namespace {

namespace fs = std::filesystem;

const fs::path kGadget = "/sys/kernel/config/usb_gadget/led";
const fs::path kEndpoints = "/dev/ffs-led";
constexpr const char* kController = "dummy_udc.0";

[[noreturn]] void fail(const std::string& action) {
  throw std::runtime_error("FunctionFS: cannot " + action + ": " + std::strerror(errno));
}

void write_file(const fs::path& file, const std::string& text) {
  std::ofstream stream(file);
  stream << text << '\n' << std::flush;
  if (!stream) fail("write " + file.string());
}

void mount_at(const char* type, const char* source, const fs::path& target) {
  fs::create_directories(target);
  if (mount(source, target.c_str(), type, 0, nullptr) != 0 && errno != EBUSY) fail("mount " + target.string());
}

// What FunctionFS is told of the device, once for each speed: one interface of two bulk endpoints, the first out, the second in.
struct [[gnu::packed]] SpeedDescriptors {
  usb_interface_descriptor interface;
  usb_endpoint_descriptor_no_audio out, in;
};
struct [[gnu::packed]] Descriptors {
  usb_functionfs_descs_head_v2 head;
  std::uint32_t full_speed_count, high_speed_count;
  SpeedDescriptors full_speed, high_speed;
};
struct [[gnu::packed]] Strings {
  usb_functionfs_strings_head head;
};

usb_endpoint_descriptor_no_audio endpoint(std::uint8_t address, std::uint16_t packet_bytes) {
  return {.bLength = sizeof(usb_endpoint_descriptor_no_audio),
          .bDescriptorType = USB_DT_ENDPOINT,
          .bEndpointAddress = address,
          .bmAttributes = USB_ENDPOINT_XFER_BULK,
          .wMaxPacketSize = htole16(packet_bytes)};
}

SpeedDescriptors descriptors(std::uint16_t packet_bytes) {
  return {.interface = {.bLength = sizeof(usb_interface_descriptor),
                        .bDescriptorType = USB_DT_INTERFACE,
                        .bNumEndpoints = 2,
                        .bInterfaceClass = capture::kLedUsbClass,
                        .bInterfaceSubClass = capture::kLedUsbSubclass,
                        .bInterfaceProtocol = capture::kLedUsbProtocol},
          .out = endpoint(1, packet_bytes),
          .in = endpoint(USB_DIR_IN | 2, packet_bytes)};
}

int open_endpoint(const std::string& name) {
  const int fd = open((kEndpoints / name).c_str(), O_RDWR | O_CLOEXEC);
  if (fd < 0) fail("open " + name);
  return fd;
}

template <typename Message>
void send(int fd, const Message& message) {
  if (write(fd, &message, sizeof message) != sizeof message) fail("describe the device");
}

sim::LedFirmwareOptions options(const std::string& serial) {
  sim::LedFirmwareOptions options;
  options.identity.serial = serial;
  return options;
}

}  // namespace

FunctionFsLed::FunctionFsLed(const std::string& serial)
    : power_on_(clock_.now()),
      firmware_(options(serial), [](core::Nanoseconds, std::span<const capture::OutputLevel>) {}) {
  mount_at("configfs", "none", "/sys/kernel/config");
  fs::create_directories(kGadget / "strings/0x409");
  fs::create_directories(kGadget / "configs/c.1");
  fs::create_directories(kGadget / "functions/ffs.led");
  write_file(kGadget / "idVendor", "0x1209");
  write_file(kGadget / "idProduct", "0x0001");
  write_file(kGadget / "strings/0x409/serialnumber", serial);
  fs::create_symlink(kGadget / "functions/ffs.led", kGadget / "configs/c.1/ffs.led");
  mount_at("functionfs", "led", kEndpoints);

  control_ = open_endpoint("ep0");
  send(control_, Descriptors{.head = {.magic = htole32(FUNCTIONFS_DESCRIPTORS_MAGIC_V2),
                                      .length = htole32(sizeof(Descriptors)),
                                      .flags = htole32(FUNCTIONFS_HAS_FS_DESC | FUNCTIONFS_HAS_HS_DESC)},
                             .full_speed_count = htole32(3),
                             .high_speed_count = htole32(3),
                             .full_speed = descriptors(64),
                             .high_speed = descriptors(512)});
  send(control_, Strings{{.magic = htole32(FUNCTIONFS_STRINGS_MAGIC), .length = htole32(sizeof(Strings))}});
  out_ = open_endpoint("ep1");
  in_ = open_endpoint("ep2");
  server_ = std::thread([this] { serve(); });
  plug();
}

FunctionFsLed::~FunctionFsLed() {
  // What the server waits for ends when the device is unplugged: it must be plugged in for that.
  if (!plugged_) plug();
  stop_ = true;
  unplug();
  server_.join();
  for (const int fd : {in_, out_, control_}) close(fd);
  umount(kEndpoints.c_str());
}

void FunctionFsLed::plug() {
  write_file(kGadget / "UDC", kController);
  plugged_ = true;
}

void FunctionFsLed::unplug() {
  write_file(kGadget / "UDC", "");
  plugged_ = false;
}

std::vector<int> FunctionFsLed::lit() const {
  const std::lock_guard lock(mutex_);
  std::vector<int> outputs;
  for (const capture::OutputLevel& level : firmware_.lit()) outputs.push_back(level.output);
  return outputs;
}

void FunctionFsLed::serve() {
  std::array<std::uint8_t, 4096> bytes{};
  while (!stop_) {
    const ssize_t count = read(out_, bytes.data(), bytes.size());
    if (count <= 0) continue;  // unplugged: the next read waits until it is plugged in again
    std::vector<std::uint8_t> answer;
    {
      const std::lock_guard lock(mutex_);
      firmware_.receive(std::span(bytes).first(static_cast<std::size_t>(count)), clock_.now() - power_on_);
      answer = firmware_.take_output();
    }
    if (!answer.empty() && write(in_, answer.data(), answer.size()) < 0) continue;
  }
}

}  // namespace lightstage::hil
