#include "capture/v4l2/capture_format.h"

#include <algorithm>

#include "capture/v4l2/controls.h"

namespace lightstage::capture {

namespace {

// In this order: what a mode locks can be written only after the mode is left.
struct Setting {
  std::uint32_t control;
  std::int64_t value;
};
constexpr Setting kManual[] = {
    {V4L2_CID_SCENE_MODE, V4L2_SCENE_MODE_NONE},
    {V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL},
    {V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0},
    {V4L2_CID_AUTOGAIN, 0},
    {V4L2_CID_ISO_SENSITIVITY_AUTO, V4L2_ISO_SENSITIVITY_MANUAL},
    {V4L2_CID_AUTO_WHITE_BALANCE, 0},
    {V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE, V4L2_WHITE_BALANCE_MANUAL},
    {V4L2_CID_FOCUS_AUTO, 0},
    {V4L2_CID_AUTOBRIGHTNESS, 0},
    {V4L2_CID_HUE_AUTO, 0},
    {V4L2_CID_CHROMA_AGC, 0},
    {V4L2_CID_BACKLIGHT_COMPENSATION, 0},
    {V4L2_CID_WIDE_DYNAMIC_RANGE, 0},
    {V4L2_CID_IMAGE_STABILIZATION, 0},
};

std::string describe(std::uint32_t fourcc, std::uint32_t width, std::uint32_t height) {
  return fourcc_text(fourcc) + " " + std::to_string(width) + "x" + std::to_string(height);
}

ColourEncoding encoding_of(const VideoDevice& device, const PixelFormat& format, const v4l2_pix_format& pixels) {
  ColourEncoding encoding;
  if (format.raw_channels() == 1) return encoding;
  // A driver that leaves the fields behind `flags` alone says so by a missing mark.
  const bool tells = pixels.priv == V4L2_PIX_FMT_PRIV_MAGIC;
  std::uint32_t colours = pixels.colorspace, transfer = 0, matrix = 0, range = 0;
  if (colours == V4L2_COLORSPACE_DEFAULT) colours = V4L2_COLORSPACE_SRGB;
  if (tells) transfer = pixels.xfer_func, matrix = pixels.ycbcr_enc, range = pixels.quantization;
  if (transfer == V4L2_XFER_FUNC_DEFAULT) transfer = V4L2_MAP_XFER_FUNC_DEFAULT(colours);
  if (matrix == V4L2_YCBCR_ENC_DEFAULT) matrix = V4L2_MAP_YCBCR_ENC_DEFAULT(colours);
  const bool is_yuv = format.layout == PixelLayout::kYuyv;

  switch (transfer) {
    case V4L2_XFER_FUNC_NONE:
      encoding.transfer = ColourEncoding::Transfer::kLinear;
      break;
    case V4L2_XFER_FUNC_SRGB:
      encoding.transfer = ColourEncoding::Transfer::kSrgb;
      break;
    case V4L2_XFER_FUNC_709:
      encoding.transfer = ColourEncoding::Transfer::kRec709;
      break;
    default:
      device.refuse("its transfer function (number " + std::to_string(transfer) +
                    " of V4L2) cannot be undone; choose a grey or Bayer format");
  }
  if (is_yuv && matrix != V4L2_YCBCR_ENC_601 && matrix != V4L2_YCBCR_ENC_709) {
    device.refuse("its YUV encoding (number " + std::to_string(matrix) +
                  " of V4L2) cannot be undone; choose a grey or Bayer format");
  }
  if (!is_yuv && range == V4L2_QUANTIZATION_LIM_RANGE) {
    device.refuse("it gives RGB of limited range; choose a grey or Bayer format");
  }
  encoding.matrix = matrix == V4L2_YCBCR_ENC_709 ? ColourEncoding::Matrix::kRec709 : ColourEncoding::Matrix::kRec601;
  encoding.full_range =
      range == V4L2_QUANTIZATION_FULL_RANGE || (range == V4L2_QUANTIZATION_DEFAULT && colours == V4L2_COLORSPACE_JPEG);
  return encoding;
}

}  // namespace

GrantedFormat set_format(const VideoDevice& device, const PixelFormat& format, int width, int height) {
  v4l2_format request{};
  request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  v4l2_pix_format& pixels = request.fmt.pix;
  pixels.width = static_cast<__u32>(width);
  pixels.height = static_cast<__u32>(height);
  pixels.pixelformat = format.fourcc;
  pixels.field = V4L2_FIELD_NONE;
  pixels.priv = V4L2_PIX_FMT_PRIV_MAGIC;
  const std::string wanted = describe(format.fourcc, pixels.width, pixels.height);
  device.call(VIDIOC_S_FMT, request, "set the format " + wanted);

  const std::string granted = describe(pixels.pixelformat, pixels.width, pixels.height);
  if (granted != wanted) {
    device.refuse("asked for " + wanted + " it grants " + granted +
                  "; `lightstage doctor` lists what it can, correct the stage file");
  }
  if (pixels.field != V4L2_FIELD_NONE && pixels.field != V4L2_FIELD_ANY) {
    device.refuse("it gives interlaced pictures as " + wanted + "; choose another format or size");
  }
  GrantedFormat result;
  const std::size_t row_bytes = format.row_bytes(width);
  result.layout = {format, width, height, pixels.bytesperline == 0 ? row_bytes : pixels.bytesperline};
  if (result.layout.row_stride < row_bytes) {
    device.refuse("its rows of " + wanted + " are too short (" + std::to_string(result.layout.row_stride) + " bytes)");
  }
  result.encoding = encoding_of(device, format, pixels);
  result.buffer_bytes = std::max<std::size_t>(pixels.sizeimage, result.layout.picture_bytes());
  return result;
}

void switch_off_automatics(const VideoDevice& device) {
  for (const auto& [id, value] : kManual) {
    const std::optional<Control> control = find_control(device, id);
    if (!control || !control->writable()) continue;
    // 0 is below the range of some compensations, which then have no off.
    const std::int64_t wanted = std::max(value, control->minimum);
    if (control_value(device, *control) != wanted) set_control(device, *control, wanted);
  }
}

void set_gain(const VideoDevice& device, int gain) {
  for (const std::uint32_t id : {V4L2_CID_GAIN, V4L2_CID_ANALOGUE_GAIN}) {
    const std::optional<Control> control = find_control(device, id);
    if (control && control->writable()) return set_control(device, *control, gain);
  }
  device.refuse("it has no gain that can be set; take `gain` out of the stage file");
}

}  // namespace lightstage::capture
