#include "capture/usb/usb_device.h"

#include <fcntl.h>
#include <libusb.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <fstream>

#include "capture/led_protocol.h"
#include "core/error.h"

namespace lightstage::capture {

namespace {

constexpr std::uint16_t kFtdiVendor = 0x0403, kFtdiProduct = 0x6001;
constexpr std::size_t kReadBytes = 16384;  // a multiple of every packet size, so that no answer is too long for it

struct ExitContext {
  void operator()(libusb_context* context) const { libusb_exit(context); }
};
struct FreeConfig {
  void operator()(libusb_config_descriptor* config) const { libusb_free_config_descriptor(config); }
};
struct UnrefDevice {
  void operator()(libusb_device* device) const { libusb_unref_device(device); }
};
using ContextHandle = std::unique_ptr<libusb_context, ExitContext>;
using ConfigHandle = std::unique_ptr<libusb_config_descriptor, FreeConfig>;
using DeviceHandle = std::unique_ptr<libusb_device, UnrefDevice>;

ContextHandle make_context(int& code) {
  libusb_context* context = nullptr;
  code = libusb_init(&context);
  return ContextHandle(code == LIBUSB_SUCCESS ? context : nullptr);
}

struct Endpoints {
  int interface = 0;
  std::uint8_t in = 0, out = 0;
  std::size_t packet_bytes = 64;
};

// A bulk endpoint each way.
std::optional<Endpoints> bulk_endpoints(const libusb_interface_descriptor& interface) {
  Endpoints found{interface.bInterfaceNumber};
  for (int i = 0; i < interface.bNumEndpoints; ++i) {
    const libusb_endpoint_descriptor& endpoint = interface.endpoint[i];
    if ((endpoint.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) != LIBUSB_TRANSFER_TYPE_BULK) continue;
    const bool in = (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_DIR_MASK) == LIBUSB_ENDPOINT_IN;
    std::uint8_t& address = in ? found.in : found.out;
    if (address != 0) continue;
    address = endpoint.bEndpointAddress;
    if (in) found.packet_bytes = std::max<std::size_t>(endpoint.wMaxPacketSize & 0x7FF, 8);
  }
  if (found.in == 0 || found.out == 0) return std::nullopt;
  return found;
}

bool speaks_our_protocol(const libusb_interface_descriptor& interface) {
  return interface.bInterfaceClass == kLedUsbClass && interface.bInterfaceSubClass == kLedUsbSubclass &&
         interface.bInterfaceProtocol == kLedUsbProtocol;
}

// How to talk to the device, if it is of this kind.
std::optional<Endpoints> endpoints_of(libusb_device* device, ControllerKind kind) {
  libusb_device_descriptor descriptor{};
  if (libusb_get_device_descriptor(device, &descriptor) != LIBUSB_SUCCESS) return std::nullopt;
  const bool ftdi = descriptor.idVendor == kFtdiVendor && descriptor.idProduct == kFtdiProduct;
  if (kind == ControllerKind::kEnttecDmxUsbPro && !ftdi) return std::nullopt;
  libusb_config_descriptor* raw = nullptr;
  if (libusb_get_active_config_descriptor(device, &raw) != LIBUSB_SUCCESS) return std::nullopt;
  const ConfigHandle config(raw);
  for (int i = 0; i < config->bNumInterfaces; ++i) {
    if (config->interface[i].num_altsetting < 1) continue;
    const libusb_interface_descriptor& interface = config->interface[i].altsetting[0];
    if (kind == ControllerKind::kLightstage && !speaks_our_protocol(interface)) continue;
    if (const auto endpoints = bulk_endpoints(interface)) return endpoints;
  }
  return std::nullopt;
}

std::string bus_path_of(libusb_device* device) {
  std::array<std::uint8_t, 7> ports{};
  const int count = libusb_get_port_numbers(device, ports.data(), int(ports.size()));
  std::string path = std::to_string(libusb_get_bus_number(device));
  for (int i = 0; i < count; ++i) path += (i == 0 ? "-" : ".") + std::to_string(ports[std::size_t(i)]);
  return path;
}

std::string node_of(libusb_device* device) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "/dev/bus/usb/%03d/%03d", libusb_get_bus_number(device),
                libusb_get_device_address(device));
  return text.data();
}

// As the kernel read it when the device was plugged in: needs no permission and no transfer. Asks the device where there is no
// sysfs.
std::string string_of(libusb_device* device, const std::string& sysfs_name, std::uint8_t index) {
  std::ifstream file("/sys/bus/usb/devices/" + bus_path_of(device) + "/" + sysfs_name);
  std::string text;
  if (file && std::getline(file, text)) return text;
  libusb_device_handle* handle = nullptr;
  if (index == 0 || libusb_open(device, &handle) != LIBUSB_SUCCESS) return {};
  std::array<unsigned char, 256> ascii{};
  const int length = libusb_get_string_descriptor_ascii(handle, index, ascii.data(), int(ascii.size()));
  libusb_close(handle);
  return length > 0 ? std::string(ascii.begin(), ascii.begin() + length) : std::string();
}

bool sounds_like_dmx(std::string product) {
  std::transform(product.begin(), product.end(), product.begin(), [](unsigned char c) { return std::toupper(c); });
  return product.find("DMX") != std::string::npos;
}

struct Found {
  DeviceHandle device;
  Endpoints endpoints;
  UsbLedsSeen seen;
  std::string node;
};

std::vector<Found> find(libusb_context* context) {
  libusb_device** list = nullptr;
  const auto count = libusb_get_device_list(context, &list);
  std::vector<Found> found;
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    DeviceHandle device(list[i]);  // each has a reference that the list gave up below
    for (const ControllerKind kind : {ControllerKind::kLightstage, ControllerKind::kEnttecDmxUsbPro}) {
      const std::optional<Endpoints> endpoints = endpoints_of(device.get(), kind);
      if (!endpoints) continue;
      libusb_device_descriptor descriptor{};
      libusb_get_device_descriptor(device.get(), &descriptor);
      UsbLedsSeen seen;
      seen.kind = kind;
      seen.product = string_of(device.get(), "product", descriptor.iProduct);
      seen.serial = string_of(device.get(), "serial", descriptor.iSerialNumber);
      seen.certain = kind == ControllerKind::kLightstage || sounds_like_dmx(seen.product);
      std::array<char, 12> ids{};
      std::snprintf(ids.data(), ids.size(), "%04x:%04x", unsigned(descriptor.idVendor), unsigned(descriptor.idProduct));
      seen.vendor_product = ids.data();
      seen.bus_path = bus_path_of(device.get());
      const std::string node = node_of(device.get());
      seen.accessible = access(node.c_str(), R_OK | W_OK) == 0;
      if (!seen.accessible) {
        seen.advice =
            "no permission to use " + node + ": install Lightstage's udev rules and plug it in again, or be root";
      }
      found.push_back({std::move(device), *endpoints, std::move(seen), node});
      break;
    }
  }
  if (count >= 0) libusb_free_device_list(list, 0);
  std::sort(found.begin(), found.end(),
            [](const Found& a, const Found& b) { return a.seen.bus_path < b.seen.bus_path; });
  return found;
}

std::string kind_name(ControllerKind kind) {
  return kind == ControllerKind::kLightstage ? "LED controller" : "DMX widget";
}

std::string describe(const std::string& serial) {
  return serial.empty() ? "" : " '" + serial + "'";
}

// The one that is meant.
const Found& choose(const std::vector<Found>& all, ControllerKind kind, const std::string& serial) {
  const std::string name = kind_name(kind);
  std::vector<const Found*> fitting;
  std::string serials;
  for (const Found& found : all) {
    const bool wanted = serial.empty() ? found.seen.certain : found.seen.serial == serial;
    if (found.seen.kind != kind || !wanted) continue;
    fitting.push_back(&found);
    serials += (serials.empty() ? "'" : ", '") + found.seen.serial + "'";
  }
  if (fitting.empty()) {
    throw core::DeviceError(name + describe(serial) +
                            " is not plugged in; check cable and power, and what `lightstage doctor` finds");
  }
  if (fitting.size() > 1) {
    throw core::DeviceError("there are " + std::to_string(fitting.size()) + " of this kind of " + name + " (" +
                            serials + "): give the serial number of the one that is meant in the stage file");
  }
  return *fitting.front();
}

std::string meaning(int code) {
  switch (code) {
    case LIBUSB_ERROR_NO_DEVICE:
    case LIBUSB_ERROR_IO:  // what some controllers give first when the device is pulled out
    case LIBUSB_ERROR_NOT_FOUND:
      return "unplugged";
    case LIBUSB_ERROR_BUSY:
      return "another program is using it";
    case LIBUSB_ERROR_OVERFLOW:
      return "it sent more than fits into a packet; its firmware is faulty";
    case LIBUSB_ERROR_PIPE:
      return "it refuses to transfer (stalled)";
    default:
      return libusb_strerror(static_cast<libusb_error>(code));
  }
}

}  // namespace

struct UsbDevice::Context {
  ContextHandle handle;
};

void UsbDevice::Closer::operator()(libusb_device_handle* handle) const {
  libusb_close(handle);
}

std::vector<UsbLedsSeen> find_usb_leds() {
  int code = 0;
  const ContextHandle context = make_context(code);
  std::vector<UsbLedsSeen> seen;
  if (!context) return seen;
  for (Found& found : find(context.get())) seen.push_back(std::move(found.seen));
  return seen;
}

UsbDevice::UsbDevice(ControllerKind kind, const std::string& serial) : name_(kind_name(kind) + describe(serial)) {
  int code = 0;
  context_ = std::make_unique<Context>(Context{make_context(code)});
  if (!context_->handle) fail("cannot use USB on this machine", code);
  const std::vector<Found> all = find(context_->handle.get());
  const Found& found = choose(all, kind, serial);
  serial_ = found.seen.serial;
  name_ = kind_name(kind) + describe(serial_);
  interface_ = found.endpoints.interface;
  in_ = found.endpoints.in;
  out_ = found.endpoints.out;
  packet_bytes_ = found.endpoints.packet_bytes;

  libusb_device_handle* raw = nullptr;
  code = libusb_open(found.device.get(), &raw);
  if (code == LIBUSB_ERROR_ACCESS) {
    throw core::DeviceError(name_ + ": no permission to use " + found.node +
                            ": install Lightstage's udev rules and plug it in again, or be root");
  }
  if (code != LIBUSB_SUCCESS) fail("cannot open " + found.node, code);
  handle_.reset(raw);
  libusb_set_auto_detach_kernel_driver(raw, 1);
  code = libusb_claim_interface(raw, interface_);
  if (code != LIBUSB_SUCCESS) fail("cannot have interface " + std::to_string(interface_) + " of " + found.node, code);
}

UsbDevice::~UsbDevice() {
  if (handle_) libusb_release_interface(handle_.get(), interface_);
}

void UsbDevice::fail(const std::string& doing, int code) const {
  throw core::DeviceError(name_ + ": " + (doing.empty() ? "" : doing + ": ") + meaning(code));
}

void UsbDevice::write(std::span<const std::uint8_t> bytes, int timeout_ms) {
  // libusb takes what it sends as not const.
  std::vector<std::uint8_t> data(bytes.begin(), bytes.end());
  for (bool freed = false;;) {
    int sent = 0;
    const int code =
        libusb_bulk_transfer(handle_.get(), out_, data.data(), int(data.size()), &sent, unsigned(timeout_ms));
    if (code == LIBUSB_SUCCESS || code == LIBUSB_ERROR_TIMEOUT || code == LIBUSB_ERROR_INTERRUPTED) return;
    if (code != LIBUSB_ERROR_PIPE || freed) fail("", code);
    if (const int clear = libusb_clear_halt(handle_.get(), out_); clear != LIBUSB_SUCCESS) fail("", clear);
    freed = true;
  }
}

std::vector<std::uint8_t> UsbDevice::read(int timeout_ms) {
  std::vector<std::uint8_t> data(kReadBytes);
  for (bool freed = false;;) {
    int received = 0;
    const int code =
        libusb_bulk_transfer(handle_.get(), in_, data.data(), int(data.size()), &received, unsigned(timeout_ms));
    if (code == LIBUSB_SUCCESS || code == LIBUSB_ERROR_TIMEOUT || code == LIBUSB_ERROR_INTERRUPTED) {
      data.resize(std::size_t(received));  // a transfer that timed out may have brought something
      return data;
    }
    if (code != LIBUSB_ERROR_PIPE || freed) fail("", code);
    if (const int clear = libusb_clear_halt(handle_.get(), in_); clear != LIBUSB_SUCCESS) fail("", clear);
    freed = true;
  }
}

void UsbDevice::vendor_request(std::uint8_t request, std::uint16_t value) {
  constexpr std::uint8_t kType = std::uint8_t(LIBUSB_ENDPOINT_OUT) | std::uint8_t(LIBUSB_REQUEST_TYPE_VENDOR) |
                                 std::uint8_t(LIBUSB_RECIPIENT_DEVICE);
  constexpr unsigned kTimeoutMs = 500;
  const int code = libusb_control_transfer(handle_.get(), kType, request, value, 0, nullptr, 0, kTimeoutMs);
  if (code < 0 && code != LIBUSB_ERROR_PIPE) fail("", code);
}

}  // namespace lightstage::capture
