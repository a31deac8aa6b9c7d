#include "model/net/scan_tensors.h"

#include <algorithm>

#include "core/interrupt.h"
#include "model/colour_gradients.h"
#include "model/net/network.h"

namespace lightstage::model {

using torch::Tensor;

ScanTensors::ScanTensors(const core::OlatScan& scan, int multiple, const std::function<void()>& picture_read) {
  const Window inner = bounding_window(scan.mask());
  window_ = rounded_up(inner, multiple);
  mask_ = torch::zeros({1, window_.height, window_.width});
  float* const inside = mask_.data_ptr<float>();
  for (int y = 0; y < inner.height; ++y) {
    for (int x = 0; x < inner.width; ++x) {
      if (!(scan.mask()(inner.y + y, inner.x + x) > 0.5f)) continue;
      masked_pixels_.emplace_back(y, x);
      inside[y * window_.width + x] = 1;
    }
  }
  const double exposure = scan.exposure();
  displays_ = stack(scan.light_count(), [&](std::size_t light) {
    picture_read();
    return to_display(*scan.image(light), exposure);
  });
}

Tensor ScanTensors::stack(std::size_t count, const std::function<Tensor(std::size_t)>& display) const {
  const auto options = torch::TensorOptions(torch::kHalf).memory_format(at::MemoryFormat::ChannelsLast);
  Tensor result = torch::empty({std::int64_t(count), 3, window_.height, window_.width}, options);
  for (std::size_t i = 0; i < count; ++i) {
    core::throw_if_interrupted();
    result[std::int64_t(i)].copy_(cut(display(i), window_).clamp_max(Network::kBrightestInput));
  }
  return result;
}

Window ScanTensors::window_around(std::uint64_t anchor, int size) const {
  const int height = int(mask_.size(1)), width = int(mask_.size(2));
  const auto [y, x] = masked_pixels_[std::size_t(anchor % masked_pixels_.size())];
  const int h = std::min(size, height), w = std::min(size, width);
  return {std::clamp(y - h / 2, 0, height - h), std::clamp(x - w / 2, 0, width - w), h, w};
}

Tensor pictures(const Tensor& stack, const std::vector<std::size_t>& indices, const Window& window) {
  const Tensor rows = torch::tensor(std::vector<std::int64_t>(indices.begin(), indices.end()));
  return cut(stack, window).index_select(0, rows).to(torch::kFloat32).contiguous(at::MemoryFormat::ChannelsLast);
}

Tensor weighted_pictures(const Tensor& weights, const Tensor& displays) {
  const std::int64_t lights = displays.size(0), height = displays.size(2), width = displays.size(3);
  const auto options = displays.options().memory_format(at::MemoryFormat::ChannelsLast);
  Tensor result = torch::empty({weights.size(0), 3, height, width}, options);
  // A few rows of pixels at a time: the whole in float32 would take twice the memory of the scan.
  constexpr std::int64_t kRows = 16;
  for (std::int64_t y = 0; y < height; y += kRows) {
    const std::int64_t rows = std::min(kRows, height - y);
    const Tensor band = displays.narrow(2, y, rows).permute({0, 2, 3, 1}).to(torch::kFloat32).reshape({lights, -1});
    const Tensor sums = torch::matmul(weights, band).clamp_(0, Network::kBrightestInput);
    result.narrow(2, y, rows).copy_(sums.view({-1, rows, width, 3}).permute({0, 3, 1, 2}));
  }
  return result;
}

Tensor gradient_pictures(const core::OlatScan& scan, const ScanTensors& tensors) {
  const auto gradients = colour_gradients(scan);
  return tensors.stack(gradients.size(), [&](std::size_t i) { return to_display(gradients[i], scan.exposure()); });
}

}  // namespace lightstage::model
