#include "hil/rig/uvc_descriptors.h"

namespace lightstage::hil {

namespace {

constexpr std::uint8_t kClassInterface = 0x24;

// Joins parts and writes their common length into the 16-bit field at `length_at` of the first.
Bytes with_total(Bytes header, ByteView rest, std::size_t length_at) {
  const std::size_t total = header.size() + rest.size();
  header[length_at] = static_cast<std::uint8_t>(total);
  header[length_at + 1] = static_cast<std::uint8_t>(total >> 8);
  append(header, rest);
  return header;
}

Bytes control_interface() {
  Bytes units;
  append(units, Bytes{18, kClassInterface, 0x02, kCameraTerminal, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0x0a, 0,
                      0});  // controls: exposure mode (bit 1), exposure time (bit 3)
  append(units, Bytes{11, kClassInterface, 0x05, kProcessingUnit, kCameraTerminal, 0, 0, 2, 0x00, 0x12,
                      0});  // controls: gain (bit 9), automatic white balance (bit 12)
  append(units, Bytes{9, kClassInterface, 0x03, 3, 0x01, 0x01, 0, kProcessingUnit, 0});  // to the USB stream
  Bytes header{13, kClassInterface, 0x01, 0x00, 0x01, 0, 0};                             // UVC 1.0
  append(header, 48'000'000, 4);                                                         // clock
  append(header, Bytes{1, kStreamingInterface});
  Bytes interface { 9, 4, kControlInterface, 0, 0, 0x0e, 0x01, 0, 0 };
  append(interface, with_total(header, units, 5));
  return interface;
}

Bytes frame_descriptor(std::uint8_t index, const UvcFormat& format, const UvcSize& size) {
  const bool compressed = format.layout == PixelLayout::kJpeg;
  Bytes d{38, kClassInterface, static_cast<std::uint8_t>(compressed ? 0x07 : 0x05), index, 0};
  append(d, static_cast<std::uint32_t>(size.width), 2);
  append(d, static_cast<std::uint32_t>(size.height), 2);
  append(d, frame_bytes(format, size) * 8, 4);        // bits per second at the slowest
  append(d, frame_bytes(format, size) * 8 * 200, 4);  // at the fastest
  append(d, frame_bytes(format, size), 4);
  append(d, kDefaultInterval, 4);
  d.push_back(0);  // any interval between
  append(d, size.shortest_interval, 4);
  append(d, kLongestInterval, 4);
  append(d, 1, 4);
  return d;
}

Bytes format_descriptor(std::uint8_t index, const UvcFormat& format) {
  if (format.layout == PixelLayout::kJpeg) {
    return {11, kClassInterface, 0x06, index, static_cast<std::uint8_t>(kUvcSizes.size()), 0, 1, 0, 0, 0, 0};
  }
  Bytes d{27, kClassInterface, 0x04, index, static_cast<std::uint8_t>(kUvcSizes.size())};
  d.insert(d.end(), format.code.begin(), format.code.end());
  append(d, Bytes{0x00, 0x00, 0x10, 0x00, 0x80, 0x00, 0x00, 0xaa, 0x00, 0x38, 0x9b, 0x71});  // the rest of the GUID
  append(d, Bytes{static_cast<std::uint8_t>(format.bits), 1, 0, 0, 0, 0});
  return d;
}

Bytes streaming_interface() {
  Bytes formats;
  for (std::size_t f = 0; f < kUvcFormats.size(); ++f) {
    append(formats, format_descriptor(static_cast<std::uint8_t>(f + 1), kUvcFormats[f]));
    for (std::size_t s = 0; s < kUvcSizes.size(); ++s) {
      append(formats, frame_descriptor(static_cast<std::uint8_t>(s + 1), kUvcFormats[f], kUvcSizes[s]));
    }
  }
  constexpr auto count = static_cast<std::uint8_t>(kUvcFormats.size());
  Bytes header{static_cast<std::uint8_t>(13 + count),
               kClassInterface,
               0x01,
               count,
               0,
               0,
               0x80 | kVideoEndpoint,
               0,
               3,
               0,
               0,
               0,
               1};
  header.insert(header.end(), count, 0);  // no controls of single formats
  Bytes interface { 9, 4, kStreamingInterface, 0, 1, 0x0e, 0x02, 0, 0 };
  append(interface, with_total(header, formats, 4));
  append(interface, Bytes{7, 5, 0x80 | kVideoEndpoint, 2, 0x00, 0x02, 0});  // bulk, 512 bytes a packet
  return interface;
}

}  // namespace

std::uint32_t frame_bytes(const UvcFormat& format, const UvcSize& size) {
  return static_cast<std::uint32_t>(size.width * size.height * format.bits / 8);
}

Bytes uvc_configuration() {
  Bytes interfaces{8, 11, kControlInterface, 2, 0x0e, 0x03, 0, 0};  // both interfaces are one function
  append(interfaces, control_interface());
  append(interfaces, streaming_interface());
  return with_total({9, 2, 0, 0, 2, 1, 0, 0x80, 250}, interfaces, 2);
}

}  // namespace lightstage::hil
