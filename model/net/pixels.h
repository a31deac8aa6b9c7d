// Between images of the other rooms and tensors of the network.
#pragma once

#include <torch/torch.h>

#include <cstddef>
#include <span>

#include "core/image.h"
#include "core/olat_scan.h"

namespace lightstage::model {

// A rectangle of pixels; it may reach beyond an image.
struct Window {
  int y = 0, x = 0, height = 0, width = 0;
};

// The smallest window around the mask's pixels above 0.5. There is at least one.
Window bounding_window(const core::Image& mask);
// The same window, grown at the bottom and the right to multiples of `multiple`.
Window rounded_up(const Window& window, int multiple);

// Display-encoded values, max(v / exposure, 0)^(1/2.2) (core/display.h), [3, h, w] in channels_last memory: grey is repeated, alpha
// dropped. Finite for all finite pixels and every exposure > 0: relative values stop at 1e30.
torch::Tensor to_display(core::ImageView linear, double exposure);
// The same of values that are encoded already (core::OlatScan::display_encoded).
torch::Tensor display_tensor(core::ImageView encoded);
// Back, for [1, 3, h, w] or [3, h, w]: linear values with 3 channels, or with 1, the mean of the three.
core::Image from_display(const torch::Tensor& display, double exposure, int channels);

// The pixels of a window, of [..., h, w]; beyond the border the border's pixels are repeated.
torch::Tensor cut(const torch::Tensor& image, const Window& window);

// What a window shows of a scan's pictures under these lights, [n, 3, h, w]; the scan is one of display_encoded() pictures.
torch::Tensor pictures_in(const core::OlatScan& encoded, std::span<const std::size_t> lights, const Window& window);

// Threads as core::thread_count() says, and memory kept by the process between uses; call before a run of network work.
void prepare_torch();

}  // namespace lightstage::model
