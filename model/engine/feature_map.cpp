#include "model/engine/feature_map.h"

#include <sys/mman.h>

#include <string>
#include <utility>

#include "core/error.h"

namespace lightstage::model {

namespace {

std::byte* map_memory(std::size_t bytes, int protection, int flags, int file, std::size_t offset) {
  if (bytes == 0) return nullptr;
  void* const memory = ::mmap(nullptr, bytes, protection, flags, file, static_cast<off_t>(offset));
  if (memory == MAP_FAILED) {
    throw core::BadInput("no memory for " + std::to_string(bytes >> 20) +
                         " MB of feature maps: use smaller images or a smaller model");
  }
  return static_cast<std::byte*>(memory);
}

}  // namespace

Pages::Pages(std::size_t bytes)
    : data_(map_memory(bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0)), size_(bytes) {
  // A hint: with small pages a row of a large map is in another page for every block.
  if (bytes >= (std::size_t(2) << 20)) ::madvise(data_, bytes, MADV_HUGEPAGE);
}

Pages::Pages(int file, std::size_t offset, std::size_t bytes)
    : data_(map_memory(bytes, PROT_READ, MAP_SHARED, file, offset)), size_(bytes) {}

Pages::~Pages() {
  if (data_ != nullptr) ::munmap(data_, size_);
}

Pages::Pages(Pages&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}

Pages& Pages::operator=(Pages&& other) noexcept {
  const Pages old = std::move(*this);
  data_ = std::exchange(other.data_, nullptr);
  size_ = std::exchange(other.size_, 0);
  return *this;
}

FeatureMap FeatureMap::shape(int height, int width, int channels, Number number, Margin margin) {
  FeatureMap map;
  map.height_ = height;
  map.width_ = width;
  map.blocks_ = blocks_of(channels);
  map.number_ = number;
  map.margin_ = margin;
  map.block_bytes_ = std::size_t(margin.left + width + margin.right) * kLanes * size_of(number);
  return map;
}

FeatureMap::FeatureMap(int height, int width, int channels, Number number, Margin margin)
    : FeatureMap(shape(height, width, channels, number, margin)) {
  pages_ = Pages(bytes());
}

void FeatureMap::allocate() {
  if (pages_.data() == nullptr) pages_ = Pages(bytes());
}

FeatureMap::FeatureMap(const FeatureMap& shape, Pages pages)
    : FeatureMap(FeatureMap::shape(shape.height_, shape.width_, shape.blocks_ * kLanes, shape.number_, shape.margin_)) {
  pages_ = std::move(pages);
}

}  // namespace lightstage::model
