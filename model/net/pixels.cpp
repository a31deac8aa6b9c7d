#include "model/net/pixels.h"

#include <ATen/Parallel.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>

#include "core/display.h"
#include "core/parallel.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr double kBrightest = 1e30;  // its encoding squared is still a float

Tensor clamped_range(int first, int count, std::int64_t size) {
  return torch::arange(first, first + count, torch::kLong).clamp(0, size - 1);
}

int round_up(int value, int multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace

Window bounding_window(const core::Image& mask) {
  int top = mask.height(), left = mask.width(), bottom = -1, right = -1;
  for (int y = 0; y < mask.height(); ++y) {
    for (int x = 0; x < mask.width(); ++x) {
      if (!(mask(y, x) > 0.5f)) continue;
      top = std::min(top, y);
      bottom = std::max(bottom, y);
      left = std::min(left, x);
      right = std::max(right, x);
    }
  }
  return {top, left, bottom - top + 1, right - left + 1};
}

Window rounded_up(const Window& window, int multiple) {
  return {window.y, window.x, round_up(window.height, multiple), round_up(window.width, multiple)};
}

Tensor to_display(core::ImageView linear, double exposure) {
  core::Image rgb = core::to_rgb(linear);
  const Tensor values = torch::from_blob(rgb.values().data(), {rgb.height(), rgb.width(), 3});
  const Tensor relative = (values.to(torch::kFloat64) / exposure).clamp(0, kBrightest).to(torch::kFloat32);
  return relative.pow(1 / core::kDisplayGamma).permute({2, 0, 1});
}

Tensor display_tensor(core::ImageView encoded) {
  core::Image rgb = core::to_rgb(encoded);
  const Tensor values = torch::from_blob(rgb.values().data(), {rgb.height(), rgb.width(), 3});
  return values.clamp(0, std::pow(kBrightest, 1 / core::kDisplayGamma)).permute({2, 0, 1});
}

core::Image from_display(const Tensor& display, double exposure, int channels) {
  Tensor linear =
      display.view({3, display.size(-2), display.size(-1)}).clamp_min(0).to(torch::kFloat64).pow(core::kDisplayGamma) *
      exposure;
  if (channels == 1) linear = linear.mean(0, true);
  const Tensor values = linear.to(torch::kFloat32).permute({1, 2, 0}).contiguous();
  core::Image image(int(values.size(0)), int(values.size(1)), int(values.size(2)));
  std::copy_n(values.data_ptr<float>(), values.numel(), image.values().begin());
  return image;
}

Tensor cut(const Tensor& image, const Window& window) {
  const std::int64_t height = image.size(-2), width = image.size(-1);
  if (window.y >= 0 && window.x >= 0 && window.y + window.height <= height && window.x + window.width <= width) {
    return image.narrow(-2, window.y, window.height).narrow(-1, window.x, window.width);
  }
  return image.index_select(-2, clamped_range(window.y, window.height, height))
      .index_select(-1, clamped_range(window.x, window.width, width));
}

Tensor pictures_in(const core::OlatScan& encoded, std::span<const std::size_t> lights, const Window& window) {
  std::vector<Tensor> pictures;
  for (const std::size_t light : lights) pictures.push_back(cut(display_tensor(*encoded.image(light)), window));
  return torch::stack(pictures);
}

void prepare_torch() {
  at::set_num_threads(core::thread_count());
  // Tensors of megabytes are made and dropped thousands of times. Were each a mapping of its own, as large blocks are by default,
  // clearing its fresh pages would cost as much as the convolutions.
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  mallopt(M_TOP_PAD, 64 << 20);
}

}  // namespace lightstage::model
