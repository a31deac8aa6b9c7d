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

// What is kept between queries of each light: its captured image, its encoding.
struct LightBytes {
  std::size_t image, encoding;
};

EngineOptions with_memory(EngineOptions options, std::size_t bytes) {
  options.budget.memory_bytes = bytes;
  return options;
}

class EngineInterpolator : public LightInterpolator {
 public:
  EngineInterpolator(const core::OlatScan& scan, const SuperresNetwork& network, const EngineOptions& options);

  std::string_view name() const override { return architecture_name(Architecture::kSuperres); }
  const core::OlatScan& scan() const override { return scan_; }
  core::Image render(const core::Direction& query) const override;

 private:
  core::ImageSize window_size() const { return {window_.height, window_.width, 3}; }
  std::size_t lights_held(std::size_t memory_bytes) const;
  void add_blend_outside(const ActiveSet& set, std::span<const float> weights, core::Image& display) const;

  std::size_t neighbours_;
  SuperresNetwork network_;
  double spacing_;
  Window mask_window_;
  Window window_;  // mask_window_, grown to the sizes that the network takes
  LightBytes bytes_;
  std::size_t lights_held_;
  core::OlatScan scan_;
  SuperresEngine engine_;
};

EngineInterpolator::EngineInterpolator(const core::OlatScan& scan, const SuperresNetwork& network,
                                       const EngineOptions& options)
    : neighbours_(std::min(std::size_t(network.config().neighbours), scan.light_count())),
      network_(network),
      spacing_(core::median_spacing_radians(scan.directions())),
      mask_window_(bounding_window(scan.mask())),
      window_(rounded_up(mask_window_, network.size_multiple())),
      bytes_{scan.image_size().value_count() * sizeof(float),
             encoding_bytes(network.config().channels, window_size(), options.storage)},
      lights_held_(lights_held(options.budget.memory_bytes)),
      scan_(scan.with_cache(lights_held_ * bytes_.image)),
      engine_(
          NetworkWeights(network).view(), window_size(), scan.directions(),
          [this](std::size_t light) { return display_window(*scan_.image(light), scan_.exposure(), window_); },
          with_memory(options, lights_held_ * bytes_.encoding)) {}

// Images and encodings share the memory: so many lights of both, or of neither where it does not hold an active set.
std::size_t EngineInterpolator::lights_held(std::size_t memory_bytes) const {
  const std::size_t lights = memory_bytes / (bytes_.image + bytes_.encoding);
  return lights < neighbours_ ? 0 : lights;
}

// The parts of the picture above, below, left and right of the mask's window. One captured image at a time: an active set of large ones
// takes more memory than all else.
void EngineInterpolator::add_blend_outside(const ActiveSet& set, std::span<const float> weights,
                                           core::Image& display) const {
  const Window& m = mask_window_;
  const int bottom = m.y + m.height, right = m.x + m.width;
  std::vector<Window> parts{{0, 0, m.y, display.width()},
                            {bottom, 0, display.height() - bottom, display.width()},
                            {m.y, 0, m.height, m.x},
                            {m.y, right, m.height, display.width() - right}};
  std::erase_if(parts, [](const Window& part) { return part.height <= 0 || part.width <= 0; });
  if (parts.empty()) return;
  for (std::size_t i = 0; i < set.lights.size(); ++i) {
    if (weights[i] == 0) continue;
    const std::shared_ptr<const core::Image> image = scan_.image(set.lights[i]);
    for (const Window& part : parts) {
      by_bands(part.height, [&](int first, int rows) {
        const core::ImageView band = image->view().crop(part.y + first, part.x, rows, part.width);
        as_tensor(display, part.y + first, rows)
            .narrow(2, part.x, part.width)
            .add_(to_display(band, scan_.exposure()), weights[i]);
      });
    }
  }
}

core::Image EngineInterpolator::render(const core::Direction& query) const {
  const c10::InferenceMode inference;
  const ActiveSet set = network_.active_set(query, scan_.directions(),
                                            core::nearest_indices(scan_.directions(), query, neighbours_), spacing_);
  const std::span<const float> weights(set.weights.data_ptr<float>(), set.lights.size());
  const core::ImageSize size = scan_.image_size();
  core::Image display = engine_.render(query, set.lights, weights);
  const bool all_inside = mask_window_.height == size.height && mask_window_.width == size.width;
  if (!all_inside || display.height() != size.height || display.width() != size.width) {
    core::Image whole(size.height, size.width, 3);
    for (int y = 0; y < mask_window_.height; ++y) {
      std::copy_n(display.pixel(y, 0), std::size_t(mask_window_.width) * 3,
                  whole.pixel(mask_window_.y + y, mask_window_.x));
    }
    display = std::move(whole);
    add_blend_outside(set, weights, display);
  }

  core::Image picture(size.height, size.width, size.channels == 1 ? 1 : 3);  // alpha is dropped
  by_bands(size.height, [&](int first, int rows) {
    const Tensor band = as_tensor(display, first, rows).contiguous(at::MemoryFormat::Contiguous);
    const core::Image linear = from_display(band, scan_.exposure(), picture.channels());
    std::ranges::copy(linear.values(), picture.pixel(first, 0));
  });
  return picture;
}

}  // namespace

std::unique_ptr<LightInterpolator> make_engine_interpolator(const core::OlatScan& scan, const SuperresNetwork& network,
                                                            const EngineOptions& options) {
  return std::make_unique<EngineInterpolator>(scan, network, options);
}

}  // namespace lightstage::model
