#include "hil/rig/usbip_device.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace lightstage::hil {

namespace {

// A header is 12 big-endian words; these are the places of those that are used.
enum Word : std::size_t {
  kCommand = 0,
  kNumber = 1,
  kDirection = 3,
  kEndpoint = 4,
  kStatus = 5,
  kSize = 6,
  kPackets = 8
};
constexpr std::size_t kVictim = 5;  // in an unlink
constexpr std::size_t kSetupBytes = 40, kHeaderBytes = 48;
enum Command : std::uint32_t { kSubmit = 1, kUnlink = 2, kSubmitted = 3, kUnlinked = 4 };
constexpr int kFullSpeed = 2, kHighSpeed = 3;

enum StandardRequest : std::uint8_t {
  kGetStatus = 0,
  kClearFeature = 1,
  kGetDescriptor = 6,
  kGetConfiguration = 8,
  kSetConfiguration = 9,
  kSetInterface = 11
};

Setup parse_setup(const std::uint8_t* bytes) {
  const auto word = [bytes](std::size_t at) { return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8); };
  return {bytes[0], bytes[1], word(2), word(4), word(6)};
}

}  // namespace

bool UsbipDevice::plug() {
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) throw std::runtime_error("no socket pair");
  FileDescriptor ours(ends[0]), kernels(ends[1]);
  const FileDescriptor attach(open("/sys/devices/platform/vhci_hcd.0/attach", O_WRONLY | O_CLOEXEC));
  if (!attach) throw std::runtime_error("no vhci-hcd here");
  // The device's number on the (imaginary) remote bus must differ between devices.
  const std::string line = std::to_string(port_) + " " + std::to_string(kernels.get()) + " " +
                           std::to_string(1 << 16 | (port_ + 2)) + " " +
                           std::to_string(identity_.full_speed ? kFullSpeed : kHighSpeed);
  if (write(attach.get(), line.data(), line.size()) < 0) {
    if (errno == EBUSY) return false;
    throw std::runtime_error("vhci-hcd refuses " + identity_.serial + ": " + std::strerror(errno));
  }
  link_ = std::move(ours);
  return true;
}

void UsbipDevice::unplug() {
  if (!link_) return;
  shutdown(link_.get(), SHUT_RDWR);
  link_.reset();
  waiting_.clear();
  unplugged();
}

void UsbipDevice::serve() {
  std::array<std::uint32_t, kHeaderBytes / 4> header{};
  if (!receive({reinterpret_cast<std::uint8_t*>(header.data()), kHeaderBytes})) return unplug();
  const auto word = [&](std::size_t at) { return ntohl(header[at]); };
  const std::uint32_t number = word(kNumber);
  if (word(kCommand) == kUnlink) return unlink(number, word(kVictim));
  if (word(kCommand) != kSubmit) throw std::runtime_error("USB/IP: unknown command");

  const bool in = word(kDirection) != 0;
  const auto endpoint = static_cast<std::uint8_t>(word(kEndpoint));
  const std::size_t size = word(kSize);
  Bytes data(in ? 0 : size);
  if (!receive(data)) return unplug();
  if (endpoint == 0) {
    control(number, size, parse_setup(reinterpret_cast<const std::uint8_t*>(header.data()) + kSetupBytes), data);
  } else if (in) {
    waiting_[endpoint].push_back({number, size});
    bulk_in_waiting(endpoint);
  } else {
    const bool accepted = bulk_out(endpoint, data);
    if (plugged()) submitted(number, accepted ? 0 : -EPIPE, accepted ? size : 0);
  }
}

std::optional<std::size_t> UsbipDevice::waiting(std::uint8_t endpoint) const {
  const auto found = waiting_.find(endpoint);
  if (found == waiting_.end() || found->second.empty()) return std::nullopt;
  return found->second.front().size;
}

void UsbipDevice::answer(std::uint8_t endpoint, ByteView data) {
  std::deque<Transfer>& queue = waiting_.at(endpoint);
  const Transfer transfer = queue.front();
  queue.pop_front();
  submitted(transfer.number, 0, data.size(), data);
}

Bytes UsbipDevice::device_descriptor() const {
  Bytes d{18, 1, 0x00, 0x02, identity_.device_class, identity_.device_subclass, identity_.device_protocol, 64};
  append(d, identity_.vendor, 2);
  append(d, identity_.product, 2);
  append(d, 0x0100, 2);                             // release
  append(d, Bytes{1, 2, 3, /*configurations*/ 1});  // strings: manufacturer, product, serial
  return d;
}

std::optional<Bytes> UsbipDevice::string_descriptor(std::uint8_t index) const {
  if (index == 0) return Bytes{4, 3, 0x09, 0x04};  // English
  if (index > 3) return std::nullopt;
  const std::string& text =
      index == 1 ? identity_.manufacturer : (index == 2 ? identity_.product_name : identity_.serial);
  Bytes d{static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
  for (const char c : text) append(d, static_cast<std::uint8_t>(c), 2);
  return d;
}

std::optional<Bytes> UsbipDevice::descriptor(std::uint16_t value) const {
  switch (value >> 8) {
    case 1:
      return device_descriptor();
    case 2:
      return configuration();
    case 3:
      return string_descriptor(static_cast<std::uint8_t>(value));
    default:
      return std::nullopt;
  }
}

std::optional<Bytes> UsbipDevice::standard_in(const Setup& setup) const {
  switch (setup.request) {
    case kGetDescriptor:
      return descriptor(setup.value);
    case kGetStatus:
      return Bytes{0, 0};
    case kGetConfiguration:
      return Bytes{1};
    default:
      return std::nullopt;
  }
}

bool UsbipDevice::standard_out(const Setup& setup) {
  if (setup.request == kClearFeature) endpoint_cleared(static_cast<std::uint8_t>(setup.index));
  return setup.request == kClearFeature || setup.request == kSetConfiguration || setup.request == kSetInterface;
}

void UsbipDevice::control(std::uint32_t number, std::size_t size, const Setup& setup, ByteView data) {
  if (setup.in()) {
    std::optional<Bytes> answer = setup.standard() ? standard_in(setup) : control_in(setup);
    if (!answer) return submitted(number, -EPIPE, 0);
    answer->resize(std::min({answer->size(), size, std::size_t{setup.length}}));
    submitted(number, 0, answer->size(), *answer);
  } else {
    const bool accepted = setup.standard() ? standard_out(setup) : control_out(setup, data);
    if (plugged()) submitted(number, accepted ? 0 : -EPIPE, accepted ? size : 0);
  }
}

void UsbipDevice::unlink(std::uint32_t number, std::uint32_t victim) {
  for (auto& [endpoint, queue] : waiting_) {
    const auto found = std::find_if(queue.begin(), queue.end(), [&](const Transfer& t) { return t.number == victim; });
    if (found == queue.end()) continue;
    queue.erase(found);
    return reply(kUnlinked, number, -ECONNRESET, 0, {});
  }
  reply(kUnlinked, number, 0, 0, {});  // it was answered already
}

void UsbipDevice::submitted(std::uint32_t number, std::int32_t status, std::size_t size, ByteView data) {
  reply(kSubmitted, number, status, size, data);
}

void UsbipDevice::reply(std::uint32_t command, std::uint32_t number, std::int32_t status, std::size_t size,
                        ByteView data) {
  std::array<std::uint32_t, kHeaderBytes / 4> header{};
  header[kCommand] = htonl(command);
  header[kNumber] = htonl(number);
  header[kStatus] = htonl(static_cast<std::uint32_t>(status));
  if (command == kSubmitted) {
    header[kSize] = htonl(static_cast<std::uint32_t>(size));
    header[kPackets] = 0xffffffff;  // not isochronous
  }
  Bytes message(kHeaderBytes);
  std::memcpy(message.data(), header.data(), kHeaderBytes);
  append(message, data);
  for (ByteView rest = message; !rest.empty();) {
    const ssize_t sent = send(link_.get(), rest.data(), rest.size(), MSG_NOSIGNAL);
    if (sent <= 0) return;  // the kernel has let go; serve() will see it
    rest = rest.subspan(static_cast<std::size_t>(sent));
  }
}

bool UsbipDevice::receive(std::span<std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t count = read(link_.get(), bytes.data(), bytes.size());
    if (count <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(count));
  }
  return true;
}

}  // namespace lightstage::hil
