#include "core/olat_scan.h"

#include <algorithm>
#include <future>
#include <limits>
#include <list>
#include <mutex>
#include <optional>
#include <utility>

#include "core/display.h"
#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::core {

namespace {

constexpr double kExposureQuantile = 0.995;
constexpr std::size_t kCandidates = std::size_t(1) << 16;  // values that a thread collects before it hands them on

std::string text_of(ImageSize size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height) + "x" + std::to_string(size.channels);
}

// Keeps the largest values of a stream whose length is known: exact, whatever the order in which they come.
class LargestValues {
 public:
  explicit LargestValues(std::size_t keep) : keep_(keep) {}

  // Values below it cannot be among the largest any more.
  float threshold() const { return threshold_; }
  void add(std::span<const float> values) {
    kept_.insert(kept_.end(), values.begin(), values.end());
    if (kept_.size() >= 2 * keep_ + kSlack) prune();
  }
  // In ascending order.
  std::vector<float> take() {
    prune();
    std::sort(kept_.begin(), kept_.end());
    return std::move(kept_);
  }

 private:
  static constexpr std::size_t kSlack = 1 << 16;

  void prune() {
    if (kept_.size() <= keep_) return;
    std::nth_element(kept_.begin(), kept_.begin() + std::ptrdiff_t(keep_ - 1), kept_.end(), std::greater<>());
    kept_.resize(keep_);
    threshold_ = kept_.back();
  }

  std::size_t keep_;
  float threshold_ = -std::numeric_limits<float>::infinity();
  std::vector<float> kept_;
};

}  // namespace

// What all copies share, whatever they cache.
struct OlatScan::Source {
  std::string name;
  std::vector<Light> lights;
  ImageSize image_size;
  std::shared_ptr<const Image> mask;
  std::size_t masked_pixel_count = 0;
  Loader loader;

  std::mutex exposure_mutex;
  std::optional<double> exposure;

  std::mutex encoded_mutex;
  std::weak_ptr<ImageCache> encoded;  // of the display-encoded scan

  double compute_exposure(ImageCache& images) const;
};

class OlatScan::ImageCache {
 public:
  using ImagePointer = std::shared_ptr<const Image>;

  ImageCache(std::shared_ptr<Source> source, std::size_t bytes)
      : source_(std::move(source)),
        bytes_(bytes),
        most_images_(bytes / (source_->image_size.value_count() * sizeof(float))),
        slots_(source_->lights.size()) {}

  const std::shared_ptr<Source>& source() const { return source_; }
  std::size_t bytes() const { return bytes_; }
  std::size_t most_images() const { return most_images_; }
  ImagePointer image(std::size_t index);
  // The image, which is not kept any longer.
  ImagePointer take(std::size_t index);

 private:
  struct Slot {
    ImagePointer image;                                       // set while cached
    std::list<std::size_t>::iterator place;                   // in recently_used_, while cached
    std::optional<std::shared_future<ImagePointer>> loading;  // set while some thread is loading it
  };
  ImagePointer load(std::size_t index) const;
  void keep(std::size_t index, const ImagePointer& image);

  std::shared_ptr<Source> source_;
  std::size_t bytes_;
  std::size_t most_images_;
  std::mutex mutex_;
  std::vector<Slot> slots_;
  std::list<std::size_t> recently_used_;  // most recent first
};

OlatScan::ImageCache::ImagePointer OlatScan::ImageCache::image(std::size_t index) {
  std::promise<ImagePointer> promise;
  {
    std::unique_lock lock(mutex_);
    Slot& slot = slots_[index];
    if (slot.image != nullptr) {
      recently_used_.splice(recently_used_.begin(), recently_used_, slot.place);
      return slot.image;
    }
    if (slot.loading) {
      const std::shared_future<ImagePointer> result = *slot.loading;
      lock.unlock();
      return result.get();
    }
    slot.loading = promise.get_future().share();
  }
  // The lock is not held here, so other images load at the same time.
  try {
    ImagePointer loaded = load(index);
    {
      const std::lock_guard lock(mutex_);
      slots_[index].loading.reset();
      keep(index, loaded);
    }
    promise.set_value(loaded);
    return loaded;
  } catch (...) {
    {
      const std::lock_guard lock(mutex_);
      slots_[index].loading.reset();
    }
    promise.set_exception(std::current_exception());
    throw;
  }
}

OlatScan::ImageCache::ImagePointer OlatScan::ImageCache::take(std::size_t index) {
  {
    const std::lock_guard lock(mutex_);
    Slot& slot = slots_[index];
    if (slot.image != nullptr) {
      recently_used_.erase(slot.place);
      return std::exchange(slot.image, nullptr);
    }
  }
  return load(index);
}

OlatScan::ImageCache::ImagePointer OlatScan::ImageCache::load(std::size_t index) const {
  auto image = std::make_shared<const Image>(source_->loader(index));
  if (image->size() != source_->image_size)
    throw BadInput("scan '" + source_->name + "': the image of light " + std::to_string(index) + " is " +
                   text_of(image->size()) + ", the scan's images are " + text_of(source_->image_size));
  return image;
}

void OlatScan::ImageCache::keep(std::size_t index, const ImagePointer& image) {
  if (most_images_ == 0) return;
  while (recently_used_.size() >= most_images_) {
    slots_[recently_used_.back()].image.reset();
    recently_used_.pop_back();
  }
  recently_used_.push_front(index);
  slots_[index].image = image;
  slots_[index].place = recently_used_.begin();
}

double OlatScan::Source::compute_exposure(ImageCache& images) const {
  const std::size_t values_per_image = masked_pixel_count * std::size_t(image_size.channels);
  const std::size_t count = values_per_image * lights.size();
  const double position = kExposureQuantile * double(count - 1);
  const std::size_t below = static_cast<std::size_t>(position);
  LargestValues largest(count - below);
  std::mutex mutex;
  const auto add_image = [&](std::size_t light) {
    const std::shared_ptr<const Image> picture = images.image(light);
    std::vector<float> candidates;
    float threshold = 0;
    const auto exchange = [&] {
      const std::lock_guard lock(mutex);
      largest.add(candidates);
      threshold = largest.threshold();
      candidates.clear();
    };
    exchange();
    for (int y = 0; y < image_size.height; ++y) {
      for (int x = 0; x < image_size.width; ++x) {
        if (!((*mask)(y, x) > 0.5f)) continue;
        const float* p = picture->pixel(y, x);
        for (int c = 0; c < image_size.channels; ++c)
          if (p[c] >= threshold) candidates.push_back(p[c]);
      }
      if (candidates.size() >= kCandidates) exchange();
    }
    exchange();
  };
  // No more images at a time than may be kept: where that is few, they are large.
  const bool all_at_once = images.most_images() >= std::size_t(thread_count());
  const std::size_t group = all_at_once ? lights.size() : std::max<std::size_t>(1, images.most_images());
  for (std::size_t start = 0; start < lights.size(); start += group) {
    parallel_for(std::min(group, lights.size() - start), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) add_image(start + i);
    });
  }
  const std::vector<float> top = largest.take();
  const double low = top.front();
  const double high = top.size() > 1 ? top[1] : top.front();
  const double percentile = std::lerp(low, high, position - double(below));
  if (percentile > 0) return percentile;
  return top.back() > 0 ? top.back() : 1;
}

OlatScan::OlatScan(std::string name, std::vector<Light> lights, ImageSize image_size, Image mask, Loader loader,
                   std::size_t cache_bytes)
    : source_(std::make_shared<Source>()) {
  const auto fail = [&](const std::string& problem) { return BadInput("scan '" + name + "': " + problem); };
  if (lights.empty()) throw fail("it has no lights");
  if (image_size.value_count() == 0) throw fail("its images have no pixels");
  if (mask.empty()) {
    mask = Image(image_size.height, image_size.width, 1);
    std::fill(mask.values().begin(), mask.values().end(), 1.0f);
  }
  if (mask.size() != ImageSize{image_size.height, image_size.width, 1})
    throw fail("its mask is " + text_of(mask.size()) + ", its images are " + text_of(image_size));
  const auto inside = std::count_if(mask.values().begin(), mask.values().end(), [](float m) { return m > 0.5f; });
  if (inside == 0) throw fail("nothing is inside its mask");

  for (const Light& light : lights) directions_.push_back(light.direction);
  for (std::size_t i = 0; i < lights.size(); ++i) source_index_.push_back(i);
  source_->name = std::move(name);
  source_->lights = std::move(lights);
  source_->image_size = image_size;
  source_->mask = std::make_shared<const Image>(std::move(mask));
  source_->masked_pixel_count = static_cast<std::size_t>(inside);
  source_->loader = std::move(loader);
  images_ = std::make_shared<ImageCache>(source_, cache_bytes);
}

const std::string& OlatScan::name() const {
  return source_->name;
}
std::size_t OlatScan::light_count() const {
  return source_index_.size();
}
const std::vector<Direction>& OlatScan::directions() const {
  return directions_;
}
ImageSize OlatScan::image_size() const {
  return source_->image_size;
}
const Image& OlatScan::mask() const {
  return *source_->mask;
}
std::size_t OlatScan::masked_pixel_count() const {
  return source_->masked_pixel_count;
}

std::size_t OlatScan::source_index(std::size_t light_index) const {
  if (light_index >= source_index_.size())
    throw BadInput("scan '" + name() + "' has lights 0 to " + std::to_string(source_index_.size() - 1) + ", not " +
                   std::to_string(light_index));
  return source_index_[light_index];
}

const Light& OlatScan::light(std::size_t light_index) const {
  return source_->lights[source_index(light_index)];
}

std::shared_ptr<const Image> OlatScan::image(std::size_t light_index) const {
  return images_->image(source_index(light_index));
}

double OlatScan::exposure() const {
  const std::lock_guard lock(source_->exposure_mutex);
  if (!source_->exposure) source_->exposure = source_->compute_exposure(*images_);
  return *source_->exposure;
}

OlatScan OlatScan::with_lights(std::span<const std::size_t> light_indices) const {
  if (light_indices.empty()) throw BadInput("scan '" + name() + "': a choice of lights needs at least one");
  OlatScan chosen = *this;
  chosen.source_index_.clear();
  chosen.directions_.clear();
  for (const std::size_t i : light_indices) {
    chosen.source_index_.push_back(source_index(i));
    chosen.directions_.push_back(directions_[i]);
  }
  return chosen;
}

OlatScan OlatScan::display_encoded() const {
  const double shown_as_one = exposure();
  OlatScan encoded = *this;
  const std::lock_guard lock(source_->encoded_mutex);
  encoded.images_ = source_->encoded.lock();
  if (encoded.images_ == nullptr) {
    const auto source = std::make_shared<Source>();
    source->name = source_->name;
    source->lights = source_->lights;
    source->image_size = source_->image_size;
    source->mask = source_->mask;
    source->masked_pixel_count = source_->masked_pixel_count;
    source->exposure = 1;
    source->loader = [images = images_, shown_as_one](std::size_t light_index) {
      Image image = *images->take(light_index);
      for (float& v : image.values()) v = display_encode(static_cast<float>(v / shown_as_one));
      return image;
    };
    encoded.images_ = std::make_shared<ImageCache>(source, images_->bytes());
    source_->encoded = encoded.images_;
  }
  encoded.source_ = encoded.images_->source();
  return encoded;
}

std::size_t OlatScan::images_kept() const {
  return images_->most_images();
}

OlatScan OlatScan::with_cache(std::size_t bytes) const {
  OlatScan same = *this;
  same.images_ = std::make_shared<ImageCache>(source_, bytes);
  return same;
}

}  // namespace lightstage::core
