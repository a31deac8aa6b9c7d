#include "hil/rig/cp2112.h"

#include <fcntl.h>
#include <linux/input.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>

#include "hil/rig/bytes.h"

namespace lightstage::hil {

namespace {

enum Report : std::uint8_t {
  kGpioConfiguration = 2,
  kGpioGet = 3,
  kGpioSet = 4,
  kVersion = 5,
  kSmbusConfiguration = 6,
  kLock = 0x20
};

// Feature reports of `bytes` bytes each, and the two of the SMBus part, which nobody uses here.
Bytes report_descriptor() {
  Bytes d{0x06, 0x00, 0xff, 0x09, 0x01, 0xa1, 0x01, 0x15, 0x00, 0x26, 0xff, 0x00, 0x75, 0x08};
  const auto report = [&d](std::uint8_t id, std::uint8_t bytes, std::uint8_t kind) {
    append(d, Bytes{0x85, id, 0x95, bytes, 0x09, id, kind, 0x02});
  };
  constexpr std::uint8_t kFeature = 0xb1, kInput = 0x81, kOutput = 0x91;
  report(kGpioConfiguration, 4, kFeature);
  report(kGpioGet, 1, kFeature);
  report(kGpioSet, 2, kFeature);
  report(kVersion, 2, kFeature);
  report(kSmbusConfiguration, 13, kFeature);
  report(kLock, 1, kFeature);
  report(0x16, 63, kInput);
  report(0x15, 63, kOutput);
  d.push_back(0xc0);
  return d;
}

}  // namespace

void Cp2112::plug() {
  uhid_ = FileDescriptor(open("/dev/uhid", O_RDWR | O_CLOEXEC));
  if (!uhid_) throw std::runtime_error("no /dev/uhid here");
  outputs_mask_ = values_ = 0;
  uhid_event event{};
  event.type = UHID_CREATE2;
  uhid_create2_req& create = event.u.create2;
  const Bytes descriptor = report_descriptor();
  std::strcpy(reinterpret_cast<char*>(create.name), "Emulated CP2112");
  std::strcpy(reinterpret_cast<char*>(create.uniq), "GPIO0");
  create.rd_size = static_cast<std::uint16_t>(descriptor.size());
  std::copy(descriptor.begin(), descriptor.end(), create.rd_data);
  create.bus = BUS_USB;
  create.vendor = 0x10c4;
  create.product = 0xea90;
  send(event);
}

void Cp2112::unplug() {
  uhid_.reset();
  set_outputs(0);
}

void Cp2112::set_input(int line, bool high) {
  const auto bit = static_cast<std::uint8_t>(1 << line);
  inputs_ = static_cast<std::uint8_t>(high ? inputs_ | bit : inputs_ & ~bit);
}

void Cp2112::serve() {
  uhid_event event{};
  if (read(uhid_.get(), &event, sizeof event) <= 0) return unplug();
  if (event.type == UHID_GET_REPORT) get_report(event.u.get_report);
  if (event.type == UHID_SET_REPORT) set_report(event.u.set_report);
}

void Cp2112::send(const uhid_event& event) {
  if (write(uhid_.get(), &event, sizeof event) < 0)
    throw std::runtime_error(std::string("uhid: ") + std::strerror(errno));
}

void Cp2112::get_report(const uhid_get_report_req& request) {
  uhid_event event{};
  event.type = UHID_GET_REPORT_REPLY;
  uhid_get_report_reply_req& reply = event.u.get_report_reply;
  reply.id = request.id;
  const auto answer = [&](Bytes bytes) {
    bytes.insert(bytes.begin(), request.rnum);
    reply.size = static_cast<std::uint16_t>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), reply.data);
  };
  switch (request.rnum) {
    case kGpioConfiguration:
      answer({outputs_mask_, 0xff, 0, 0});
      break;  // outputs push-pull
    case kGpioGet:
      answer({static_cast<std::uint8_t>((values_ & outputs_mask_) | (inputs_ & ~outputs_mask_))});
      break;
    case kVersion:
      answer({0x0c, 2});
      break;
    case kSmbusConfiguration:
      answer(Bytes(13, 0));
      break;
    case kLock:
      answer({0});
      break;
    default:
      reply.err = EIO;
  }
  send(event);
}

void Cp2112::set_report(const uhid_set_report_req& request) {
  uhid_event event{};
  event.type = UHID_SET_REPORT_REPLY;
  event.u.set_report_reply.id = request.id;
  const bool set = request.data[0] == kGpioSet;
  if (set && on_request) on_request();
  if (!plugged()) return;  // a fault unplugged it
  const bool refused = set && refuse_ > 0, ignored = set && ignore_ > 0;
  refuse_ -= refused;
  ignore_ -= ignored;
  if (refused) event.u.set_report_reply.err = EIO;
  send(event);
  if (refused || ignored) return;
  if (request.data[0] == kGpioConfiguration) outputs_mask_ = request.data[1];
  // Values, and which lines they are for.
  if (set) set_outputs(static_cast<std::uint8_t>((values_ & ~request.data[2]) | (request.data[1] & request.data[2])));
}

void Cp2112::set_outputs(std::uint8_t values) {
  const unsigned changed = (values ^ values_) & outputs_mask_;
  values_ = values;
  for (int line = 0; line < 8; ++line) {
    if (on_line && (changed >> line & 1)) on_line(line, (values >> line & 1) != 0);
  }
}

}  // namespace lightstage::hil
