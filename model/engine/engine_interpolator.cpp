#include "model/engine/engine_interpolator.h"

#include <torch/torch.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "core/parallel.h"
#include "core/sphere.h"
#include "model/engine/network_weights.h"
#include "model/net/pixels.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

// Pictures are encoded and decoded so many rows at a time: in between, numbers are float64.
constexpr int kRows = 64;

// The rows and columns of `window` that lie in the image.
Window inside(const Window& window, core::ImageSize size) {
  return {window.y, window.x, std::min(window.height, size.height - window.y),
          std::min(window.width, size.width - window.x)};
}

// Calls body(first row, rows) for rows that cover [0, count).
template <class Body>
void by_bands(int count, const Body& body) {
  for (int first = 0; first < count; first += kRows) body(first, std::min(kRows, count - first));
}

// As a tensor [3, h, w] of the same memory.
Tensor as_tensor(const core::Image& image, int first, int rows) {
  float* const data = const_cast<float*>(image.pixel(first, 0));
  return torch::from_blob(data, {rows, image.width(), 3}).permute({2, 0, 1});
}

// Display-encoded pixels of the window; beyond the image its border repeated.
core::Image display_window(core::ImageView linear, double exposure, const Window& window) {
  core::Image result(window.height, window.width, 3);
  const Window there = inside(window, linear.size());
  by_bands(there.height, [&](int first, int rows) {
    const core::ImageView band = linear.crop(there.y + first, there.x, rows, there.width);
    as_tensor(result, first, rows).narrow(2, 0, there.width).copy_(to_display(band, exposure));
  });
  for (int y = 0; y < there.height; ++y) {
    for (int x = there.width; x < window.width; ++x)
      std::copy_n(result.pixel(y, there.width - 1), 3, result.pixel(y, x));
  }
  for (int y = there.height; y < window.height; ++y) {
    std::copy_n(result.pixel(there.height - 1, 0), std::size_t(window.width) * 3, result.pixel(y, 0));
  }
  return result;
}

class EngineInterpolator : public LightInterpolator {
 public:
  EngineInterpolator(const core::OlatScan& scan, const SuperresNetwork& network, const EngineOptions& options)
      : scan_(scan),
        neighbours_(std::size_t(network.config().neighbours)),
        network_(network),
        spacing_(core::median_spacing_radians(scan.directions())),
        mask_window_(bounding_window(scan.mask())),
        window_(rounded_up(mask_window_, network.size_multiple())),
        engine_(
            NetworkWeights(network).view(), {window_.height, window_.width, 3}, scan.directions(),
            [this](std::size_t light) { return display_window(*scan_.image(light), scan_.exposure(), window_); },
            options) {}

  std::string_view name() const override { return architecture_name(Architecture::kSuperres); }
  const core::OlatScan& scan() const override { return scan_; }
  core::Image render(const core::Direction& query) const override;

 private:
  void blend_outside(const ActiveSet& set, std::span<const float> weights, core::Image& picture) const;

  core::OlatScan scan_;
  std::size_t neighbours_;
  SuperresNetwork network_;
  double spacing_;
  Window mask_window_;
  Window window_;  // mask_window_, grown to the sizes that the network takes
  SuperresEngine engine_;
};

// The parts of the picture above, below, left and right of the mask's window.
void EngineInterpolator::blend_outside(const ActiveSet& set, std::span<const float> weights,
                                       core::Image& picture) const {
  const Window& m = mask_window_;
  const int bottom = m.y + m.height, right = m.x + m.width;
  std::vector<Window> parts{{0, 0, m.y, picture.width()},
                            {bottom, 0, picture.height() - bottom, picture.width()},
                            {m.y, 0, m.height, m.x},
                            {m.y, right, m.height, picture.width() - right}};
  std::erase_if(parts, [](const Window& part) { return part.height <= 0 || part.width <= 0; });
  if (parts.empty()) return;
  std::vector<std::shared_ptr<const core::Image>> images;
  for (std::size_t i = 0; i < set.lights.size(); ++i) {
    images.push_back(weights[i] == 0 ? nullptr : scan_.image(set.lights[i]));
  }
  for (const Window& part : parts) {
    by_bands(part.height, [&](int first, int rows) {
      Tensor sum = torch::zeros({3, rows, part.width});
      for (std::size_t i = 0; i < images.size(); ++i) {
        if (images[i] == nullptr) continue;
        const core::ImageView band = images[i]->view().crop(part.y + first, part.x, rows, part.width);
        sum += weights[i] * to_display(band, scan_.exposure());
      }
      const core::Image band = from_display(sum, scan_.exposure(), picture.channels());
      for (int y = 0; y < rows; ++y) {
        std::copy_n(band.pixel(y, 0), std::size_t(part.width * picture.channels()),
                    picture.pixel(part.y + first + y, part.x));
      }
    });
  }
}

core::Image EngineInterpolator::render(const core::Direction& query) const {
  const c10::InferenceMode inference;
  const ActiveSet set = network_.active_set(query, scan_.directions(),
                                            core::nearest_indices(scan_.directions(), query, neighbours_), spacing_);
  const std::span<const float> weights(set.weights.data_ptr<float>(), set.lights.size());
  const core::Image window = engine_.render(query, set.lights, weights);

  const core::ImageSize size = scan_.image_size();
  core::Image picture(size.height, size.width, size.channels == 1 ? 1 : 3);  // alpha is dropped
  by_bands(mask_window_.height, [&](int first, int rows) {
    const Tensor band = as_tensor(window, first, rows).narrow(2, 0, mask_window_.width);
    const core::Image linear =
        from_display(band.contiguous(at::MemoryFormat::Contiguous), scan_.exposure(), picture.channels());
    for (int y = 0; y < rows; ++y) {
      std::copy_n(linear.pixel(y, 0), std::size_t(mask_window_.width * picture.channels()),
                  picture.pixel(mask_window_.y + first + y, mask_window_.x));
    }
  });
  blend_outside(set, weights, picture);
  return picture;
}

}  // namespace

std::unique_ptr<LightInterpolator> make_engine_interpolator(const core::OlatScan& scan, const SuperresNetwork& network,
                                                            const EngineOptions& options) {
  return std::make_unique<EngineInterpolator>(scan, network, options);
}

}  // namespace lightstage::model
