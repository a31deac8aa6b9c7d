#include "hil/rig/uvc_camera.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "hil/rig/now.h"

namespace lightstage::hil {

namespace {

// Class requests; those that read have bit 7 set.
enum Request : std::uint8_t {
  kSetCurrent = 0x01,
  kGetCurrent = 0x81,
  kGetMinimum,
  kGetMaximum,
  kGetResolution,
  kGetLength,
  kGetInfo,
  kGetDefault
};
constexpr std::uint8_t kReadable = 1, kWritable = 2;
constexpr std::uint8_t kCommit = 2;                                 // selector; 1 is probe
constexpr std::size_t kProbeBytes = 26;                             // of UVC 1.0
constexpr std::uint32_t kPayloadBytes = 16384, kPayloadHeader = 2;  // the largest transfer, and what begins it
enum PayloadFlag : std::uint8_t { kFrameId = 0x01, kEndOfFrame = 0x02, kError = 0x40, kEndOfHeader = 0x80 };

constexpr std::uint32_t kShortestExposure = 1, kLongestExposure = 10'000, kAutomaticExposure = 333;  // 100 us
constexpr Nanoseconds kExposureUnit = 100'000, kIntervalUnit = 100;
constexpr double kFullScaleExposure = 10e6;  // ns in which level 1 fills the scale
constexpr double kUnityGain = 16, kMaximumGain = 255, kBlack = 1.0 / 64;
constexpr float kAutomaticRed = 1.3f;
constexpr std::size_t kFramesHeld = 2;

struct Range {
  std::uint32_t minimum = 0, maximum = 0, resolution = 1, standard = 0;
  int width = 1;
};

std::optional<Bytes> read_control(std::uint8_t request, std::uint32_t current, const Range& range) {
  Bytes bytes;
  switch (request) {
    case kGetCurrent:
      append(bytes, current, range.width);
      break;
    case kGetMinimum:
      append(bytes, range.minimum, range.width);
      break;
    case kGetMaximum:
      append(bytes, range.maximum, range.width);
      break;
    case kGetResolution:
      append(bytes, range.resolution, range.width);
      break;
    case kGetDefault:
      append(bytes, range.standard, range.width);
      break;
    case kGetLength:
      append(bytes, static_cast<std::uint32_t>(range.width), 2);
      break;
    case kGetInfo:
      return Bytes{kReadable | kWritable};
    default:
      return std::nullopt;
  }
  return bytes;
}

constexpr Range kExposureModeRange{1, 2, /*the modes there are, as bits*/ 3, 2, 1};
constexpr Range kExposureRange{kShortestExposure, kLongestExposure, 1, kAutomaticExposure, 4};
constexpr Range kGainRange{0, static_cast<std::uint32_t>(kMaximumGain), 1, 16, 2};
constexpr Range kSwitchRange{0, 1, 1, 1, 1};

// Unit and selector of a control request in one number.
constexpr int selected(std::uint8_t unit, std::uint8_t selector) {
  return unit << 8 | selector;
}
int selected(const Setup& setup) {
  return selected(static_cast<std::uint8_t>(setup.index >> 8), static_cast<std::uint8_t>(setup.value >> 8));
}

template <typename Number>
bool write_control(Number& current, ByteView data, const Range& range) {
  const std::uint32_t value = number(data, static_cast<std::size_t>(range.width));
  if (value < range.minimum || value > range.maximum) return false;
  current = static_cast<Number>(value);
  return true;
}

}  // namespace

UvcCamera::UvcCamera(int index, const Scene& scene)
    : UsbipDevice(index + 1, {.vendor = 0x1209,
                              .product = 0x0002,
                              .device_class = 0xef,
                              .device_subclass = 2,
                              .device_protocol = 1,
                              .manufacturer = "Lightstage",
                              .product_name = "Emulated camera",
                              .serial = "CAM" + std::to_string(index)}),
      index_(index),
      scene_(scene) {}

bool UvcCamera::trigger(Nanoseconds time) {
  if (!streaming_ || free_running_ || exposing_ || frames_.size() >= kFramesHeld) return false;
  begin_exposure(time);
  return true;
}

std::optional<Nanoseconds> UvcCamera::next_event() const {
  std::optional<Nanoseconds> next;
  const auto consider = [&](Nanoseconds time) { next = next ? std::min(*next, time) : time; };
  if (exposing_) consider(exposing_->end);
  if (streaming_ && free_running_ && !exposing_) consider(next_start_);
  // A frame that is ready waits for the host, not for time.
  if (!frames_.empty() && frames_.front().ready > now()) consider(frames_.front().ready);
  return next;
}

void UvcCamera::advance(Nanoseconds time) {
  if (exposing_ && exposing_->end <= time) end_exposure();
  if (streaming_ && free_running_ && !exposing_ && next_start_ <= time) begin_exposure(next_start_);
  send();
}

void UvcCamera::begin_exposure(Nanoseconds time) {
  const Nanoseconds exposed =
      kExposureUnit * (settings_.exposure_mode == 1 ? settings_.exposure_time : kAutomaticExposure);
  const int number = ++exposures_;
  const FrameFault fault = fault_of ? fault_of(number) : FrameFault{};
  if (!streaming_) return;  // the fault unplugged it
  exposing_ = Exposure{number, time, time + exposed, {}, fault};
  next_start_ = time + std::max(exposed, settings_.interval * kIntervalUnit);
  if (on_strobe) on_strobe(Strobe::kOn, time);
}

void UvcCamera::end_exposure() {
  Exposure done = *std::exchange(exposing_, std::nullopt);
  done.levels = scene_.mean(done.start, done.end);
  // First the picture: the strobe's end may change the light.
  if (!done.fault.drop && frames_.size() < kFramesHeld) {
    Frame frame{done.end + done.fault.delay, picture(done.levels, done.end - done.start), done.fault.flag_error};
    if (done.fault.truncate) frame.data.resize(frame.data.size() / 2);
    if (done.fault.duplicate) frames_.push_back(frame);
    frames_.push_back(std::move(frame));
  }
  if (on_exposure) on_exposure(done);
  if (on_strobe) on_strobe(Strobe::kOff, done.end);
}

Bytes UvcCamera::picture(const Levels& levels, Nanoseconds exposed) const {
  const int width = size().width, height = size().height;
  const int bytes = format().bits / 8;
  const double scale = static_cast<double>(exposed) / kFullScaleExposure * settings_.gain / kUnityGain;
  const PixelLayout layout = format().layout;
  const bool wide = layout == PixelLayout::kGrey16 || layout == PixelLayout::kBayerRggb16;
  const double zero = layout == PixelLayout::kYuyv ? 16 : 0;
  const double full = wide ? 65535 : (layout == PixelLayout::kYuyv ? 235 : 255);
  const auto raw = [&](double level) {
    return static_cast<std::uint32_t>(std::lround(zero + (full - zero) * std::min(1.0, kBlack + level * scale)));
  };
  Bytes data(static_cast<std::size_t>(width * height * bytes));
  const auto put = [&](int x, int y, std::uint32_t value) {
    std::uint8_t* pixel = &data[static_cast<std::size_t>((y * width + x) * bytes)];
    pixel[0] = static_cast<std::uint8_t>(value);
    if (wide) pixel[1] = static_cast<std::uint8_t>(value >> 8);
    if (layout == PixelLayout::kYuyv) pixel[1] = 128;  // no colour
  };
  const int cell_width = width / static_cast<int>(kCellColumns), cell_height = height / static_cast<int>(kCellRows);
  for (std::size_t cell = 0; cell < kCells; ++cell) {
    const float red = levels[cell][0] * (settings_.white_balance_auto ? kAutomaticRed : 1.0f);
    const float green = levels[cell][1], blue = levels[cell][2];
    const std::uint32_t colours[3] = {raw(red), raw(green), raw(blue)},
                        grey = raw((levels[cell][0] + green + blue) / 3);
    const int left = static_cast<int>(cell % kCellColumns) * cell_width,
              top = static_cast<int>(cell / kCellColumns) * cell_height;
    for (int y = top; y < top + cell_height; ++y) {
      for (int x = left; x < left + cell_width; ++x) {
        // Rows of red and green, then of green and blue.
        put(x, y, layout == PixelLayout::kBayerRggb16 ? colours[x % 2 + y % 2] : grey);
      }
    }
  }
  return data;
}

void UvcCamera::send() {
  while (!frames_.empty() && frames_.front().ready <= now()) {
    const std::optional<std::size_t> room = waiting(kVideoEndpoint);
    if (!room) return;
    Frame& frame = frames_.front();
    const std::size_t payload = std::min<std::size_t>(*room, kPayloadBytes) - kPayloadHeader;
    const std::size_t count = std::min(payload, frame.data.size() - frame.sent);
    const bool last = frame.sent + count == frame.data.size();
    Bytes bytes{kPayloadHeader,
                static_cast<std::uint8_t>(kEndOfHeader | (frame_id_ ? kFrameId : 0) | (last ? kEndOfFrame : 0) |
                                          (last && frame.flag_error ? kError : 0))};
    append(bytes, ByteView(frame.data).subspan(frame.sent, count));
    frame.sent += count;
    if (last) {
      frames_.pop_front();
      frame_id_ = !frame_id_;
    }
    answer(kVideoEndpoint, bytes);
  }
}

void UvcCamera::start() {
  stop();
  streaming_ = true;
  next_start_ = now();
  if (on_stream) on_stream(true);
}

void UvcCamera::stop() {
  const bool was = std::exchange(streaming_, false);
  exposing_.reset();
  frames_.clear();
  if (was && on_stream) on_stream(false);
}

void UvcCamera::unplugged() {
  stop();
  settings_ = {};
}

void UvcCamera::endpoint_cleared(std::uint8_t endpoint) {
  // How uvcvideo ends a bulk stream.
  if (endpoint == (0x80 | kVideoEndpoint)) stop();
}

Bytes UvcCamera::probe() const {
  Bytes bytes;
  append(bytes, 1, 2);  // the interval is kept, the rest follows
  append(bytes, settings_.format, 1);
  append(bytes, settings_.size, 1);
  append(bytes, settings_.interval, 4);
  append(bytes, Bytes(10, 0));  // compression and delay
  append(bytes, frame_bytes(format(), size()), 4);
  append(bytes, kPayloadBytes, 4);
  return bytes;
}

void UvcCamera::set_probe(ByteView data) {
  settings_.format = std::clamp<std::uint8_t>(data[2], 1, kUvcFormats.size());
  settings_.size = std::clamp<std::uint8_t>(data[3], 1, kUvcSizes.size());
  settings_.interval = std::clamp(number(data.subspan(4), 4), size().shortest_interval, kLongestInterval);
}

std::optional<Bytes> UvcCamera::streaming_in(const Setup& setup) const {
  if (setup.request == kGetInfo) return Bytes{kReadable | kWritable};
  if (setup.request == kGetLength) return Bytes{kProbeBytes, 0};
  return probe();
}

bool UvcCamera::streaming_out(const Setup& setup, ByteView data) {
  if (setup.request != kSetCurrent || data.size() < kProbeBytes) return false;
  set_probe(data);
  if (setup.value >> 8 == kCommit) start();
  return true;
}

std::optional<Bytes> UvcCamera::control_in(const Setup& setup) {
  if ((setup.index & 0xff) == kStreamingInterface) return streaming_in(setup);
  switch (selected(setup)) {
    case selected(kCameraTerminal, kExposureMode):
      return read_control(setup.request, settings_.exposure_mode, kExposureModeRange);
    case selected(kCameraTerminal, kExposureTime):
      return read_control(setup.request, settings_.exposure_time, kExposureRange);
    case selected(kProcessingUnit, kGain):
      return read_control(setup.request, settings_.gain, kGainRange);
    case selected(kProcessingUnit, kWhiteBalanceAuto):
      return read_control(setup.request, settings_.white_balance_auto, kSwitchRange);
    default:
      return std::nullopt;
  }
}

bool UvcCamera::control_out(const Setup& setup, ByteView data) {
  if ((setup.index & 0xff) == kStreamingInterface) return streaming_out(setup, data);
  switch (selected(setup)) {
    case selected(kCameraTerminal, kExposureMode):
      return write_control(settings_.exposure_mode, data, kExposureModeRange);
    case selected(kCameraTerminal, kExposureTime):
      return write_control(settings_.exposure_time, data, kExposureRange);
    case selected(kProcessingUnit, kGain):
      return write_control(settings_.gain, data, kGainRange);
    case selected(kProcessingUnit, kWhiteBalanceAuto):
      return write_control(settings_.white_balance_auto, data, kSwitchRange);
    default:
      return false;
  }
}

}  // namespace lightstage::hil
