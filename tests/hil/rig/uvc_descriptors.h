// How the emulated camera presents itself: USB Video Class 1.0 with one bulk endpoint, four uncompressed formats and one compressed.
#pragma once

#include <array>
#include <string_view>

#include "hil/rig/bytes.h"

namespace lightstage::hil {

enum class PixelLayout { kGrey8, kGrey16, kBayerRggb16, kYuyv, kJpeg };

struct UvcFormat {
  std::string_view code;  // the first four bytes of the GUID
  PixelLayout layout = PixelLayout::kGrey8;
  int bits = 8;  // a pixel
};
// The format of index i + 1. Motion JPEG is there to be refused: the camera sends nothing in it.
constexpr std::array<UvcFormat, 5> kUvcFormats{{{"Y800", PixelLayout::kGrey8, 8},
                                                {"Y16 ", PixelLayout::kGrey16, 16},
                                                {"RG16", PixelLayout::kBayerRggb16, 16},
                                                {"YUY2", PixelLayout::kYuyv, 16},
                                                {"MJPG", PixelLayout::kJpeg, 16}}};

// Times between frames are in units of 100 ns.
struct UvcSize {
  int width = 0, height = 0;
  std::uint32_t shortest_interval = 0;  // any from this to kLongestInterval
};
// The smallest is for cameras that run free: their pictures come whether the machine has time for them or not.
constexpr std::array<UvcSize, 3> kUvcSizes{{{320, 240, 333'333}, {160, 120, 100'000}, {80, 60, 333'333}}};
constexpr std::uint32_t kDefaultInterval = 333'333, kLongestInterval = 10'000'000;

constexpr std::uint8_t kControlInterface = 0, kStreamingInterface = 1, kVideoEndpoint = 1;
constexpr std::uint8_t kCameraTerminal = 1, kProcessingUnit = 2;
// Selectors of the controls that the units have (UVC 1.0, table ).
enum CameraControl : std::uint8_t { kExposureMode = 0x02, kExposureTime = 0x04 };
enum ProcessingControl : std::uint8_t { kGain = 0x04, kWhiteBalanceAuto = 0x0b };

std::uint32_t frame_bytes(const UvcFormat& format, const UvcSize& size);

Bytes uvc_configuration();

}  // namespace lightstage::hil
