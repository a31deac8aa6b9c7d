#include "model/superres.h"

#include <algorithm>
#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include "core/sphere.h"
#include "model/classical.h"
#include "model/net/network.h"
#include "model/net/network_file.h"
#include "model/net/pixels.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

// A captured image as queries use it.
struct Encoding {
  Tensor display;    // [3, h, w], the whole image
  Pyramid features;  // of the window around the mask, one image

  std::size_t bytes() const {
    std::int64_t values = display.numel();
    for (const Tensor& level : features) values += level.numel();
    return static_cast<std::size_t>(values) * sizeof(float);
  }
};

// Encodings by light, the most recently used ones up to a number of bytes.
class EncodingCache {
 public:
  using Pointer = std::shared_ptr<const Encoding>;

  explicit EncodingCache(std::size_t bytes) : bytes_allowed_(bytes) {}

  // Made outside the lock: two threads may make the same one, which then is the same.
  template <class Make>
  Pointer get(std::size_t light, const Make& make) {
    if (Pointer found = find(light)) return found;
    const auto made = std::make_shared<const Encoding>(make());
    keep(light, made);
    return made;
  }

 private:
  struct Slot {
    Pointer encoding;
    std::list<std::size_t>::iterator place;
  };

  Pointer find(std::size_t light) {
    const std::lock_guard lock(mutex_);
    const auto slot = slots_.find(light);
    if (slot == slots_.end()) return nullptr;
    recently_used_.splice(recently_used_.begin(), recently_used_, slot->second.place);
    return slot->second.encoding;
  }

  void keep(std::size_t light, const Pointer& encoding) {
    const std::lock_guard lock(mutex_);
    if (encoding->bytes() > bytes_allowed_ || slots_.contains(light)) return;
    while (bytes_used_ + encoding->bytes() > bytes_allowed_) {
      const auto oldest = slots_.find(recently_used_.back());
      bytes_used_ -= oldest->second.encoding->bytes();
      slots_.erase(oldest);
      recently_used_.pop_back();
    }
    recently_used_.push_front(light);
    slots_[light] = {encoding, recently_used_.begin()};
    bytes_used_ += encoding->bytes();
  }

  const std::size_t bytes_allowed_;
  std::mutex mutex_;
  std::size_t bytes_used_ = 0;
  std::map<std::size_t, Slot> slots_;
  std::list<std::size_t> recently_used_;  // most recent first
};

class Superres : public LightInterpolator {
 public:
  Superres(const core::OlatScan& scan, Network network, std::size_t cache_bytes)
      : scan_(scan),
        network_(std::move(network)),
        guide_(make_rbf(scan, Domain::kDisplay)),
        spacing_(core::median_spacing_radians(scan.directions())),
        mask_window_(bounding_window(scan.mask())),
        window_(rounded_up(mask_window_, network_.size_multiple())),
        cache_(cache_bytes) {
    prepare_torch();
  }

  std::string_view name() const override { return "superres"; }
  const core::OlatScan& scan() const override { return scan_; }
  core::Image render(const core::Direction& query) const override;

 private:
  Encoding encode(std::size_t light) const;
  Tensor window_logits(const std::vector<EncodingCache::Pointer>& encodings, const Tensor& images,
                       const core::Direction& query, const ActiveSet& set) const;

  core::OlatScan scan_;
  Network network_;
  std::unique_ptr<LightInterpolator> guide_;
  double spacing_;
  Window mask_window_;
  Window window_;  // mask_window_, grown to the sizes that the network takes
  mutable EncodingCache cache_;
};

Encoding Superres::encode(std::size_t light) const {
  Encoding encoding;
  encoding.display = to_display(*scan_.image(light), scan_.exposure());
  const core::Vec3 l = scan_.directions()[light].vec();
  const Tensor direction = torch::tensor({float(l.x), float(l.y), float(l.z)}).unsqueeze(0);
  encoding.features = network_.encode(cut(encoding.display, window_).unsqueeze(0), direction);
  return encoding;
}

Tensor Superres::window_logits(const std::vector<EncodingCache::Pointer>& encodings, const Tensor& images,
                               const core::Direction& query, const ActiveSet& set) const {
  Pyramid features;
  for (std::size_t level = 0; level < network_.config().channels.size(); ++level) {
    std::vector<Tensor> images_of_level;
    for (const auto& encoding : encodings) images_of_level.push_back(encoding->features[level]);
    features.push_back(torch::cat(images_of_level));
  }
  const Tensor guide = to_display(guide_->render(query), scan_.exposure()).unsqueeze(0);
  return network_.logits(features, cut(images, window_), cut(guide, window_), set);
}

core::Image Superres::render(const core::Direction& query) const {
  const c10::InferenceMode inference;
  const std::vector<core::Direction>& lights = scan_.directions();
  const ActiveSet set = network_.active_set(
      query, lights, core::nearest_indices(lights, query, std::size_t(network_.config().neighbours)), spacing_);

  std::vector<EncodingCache::Pointer> encodings;
  std::vector<Tensor> displays;
  for (const std::size_t light : set.lights) {
    encodings.push_back(cache_.get(light, [&] { return encode(light); }));
    displays.push_back(encodings.back()->display);
  }
  const Tensor images = torch::stack(displays);

  // Logits of 0 outside the mask's window: linear blending there.
  const core::ImageSize size = scan_.image_size();
  Tensor logits = torch::zeros({images.size(0), 1, size.height, size.width});
  const Tensor inside = window_logits(encodings, images, query, set);
  cut(logits, mask_window_).copy_(cut(inside, {0, 0, mask_window_.height, mask_window_.width}));
  return from_display(blend(images, set.weights, logits), scan_.exposure(), size.channels);
}

}  // namespace

std::unique_ptr<LightInterpolator> make_superres(const core::OlatScan& scan, const std::filesystem::path& checkpoint,
                                                 std::size_t cache_bytes) {
  return std::make_unique<Superres>(scan, load_network(checkpoint), cache_bytes);
}

}  // namespace lightstage::model
