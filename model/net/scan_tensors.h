// The pictures of a scan as training keeps them: display-encoded, limited to what networks see, around the mask, in half precision.
#pragma once

#include <torch/torch.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "core/olat_scan.h"
#include "model/net/pixels.h"

namespace lightstage::model {

class ScanTensors {
 public:
  // Heights and widths are rounded up to `multiple`. 6 bytes a light and pixel. `picture_read` is called once a light.
  ScanTensors(
      const core::OlatScan& scan, int multiple, const std::function<void()>& picture_read = [] {});

  // Other pictures of the same camera in the same units, [n, 3, h, w]; they are cut and limited likewise.
  torch::Tensor stack(std::size_t count, const std::function<torch::Tensor(std::size_t)>& display) const;

  // [lights, 3, h, w] and [1, h, w] (0 or 1).
  const torch::Tensor& displays() const { return displays_; }
  const torch::Tensor& mask() const { return mask_; }

  // `size` pixels square, or less where the scan is smaller, around the masked pixel whose number is `anchor` modulo their number.
  Window window_around(std::uint64_t anchor, int size) const;

 private:
  Window window_;
  std::vector<std::pair<int, int>> masked_pixels_;  // (y, x)
  torch::Tensor displays_, mask_;
};

// Pictures `indices` of a stack, of a window: float32 in channels_last memory.
torch::Tensor pictures(const torch::Tensor& stack, const std::vector<std::size_t>& indices, const Window& window);

// Sums of a scan's pictures, one a row of weights [n, lights]: [n, 3, h, w], half precision, limited likewise.
torch::Tensor weighted_pictures(const torch::Tensor& weights, const torch::Tensor& displays);

// The colour gradients of a scan (model/colour_gradients.h), cut and limited likewise: [2, 3, h, w].
torch::Tensor gradient_pictures(const core::OlatScan& scan, const ScanTensors& tensors);

}  // namespace lightstage::model
