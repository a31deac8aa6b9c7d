#include "model/engine/feature_map.h"

#include <sys/mman.h>

#include <string>
#include <utility>

#include "core/error.h"

namespace lightstage::model {

Pages::Pages(std::size_t bytes) : size_(bytes) {
  if (bytes == 0) return;
  void* const memory = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) {
    throw core::BadInput("no memory for " + std::to_string(bytes >> 20) +
                         " MB of feature maps: use smaller images or a smaller model");
  }
  // A hint: with small pages a row of a large map is in another page for every block.
  if (bytes >= (std::size_t(2) << 20)) ::madvise(memory, bytes, MADV_HUGEPAGE);
  data_ = static_cast<std::byte*>(memory);
}

Pages::~Pages() {
  if (data_ != nullptr) ::munmap(data_, size_);
}

Pages::Pages(Pages&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}

Pages& Pages::operator=(Pages&& other) noexcept {
  std::swap(data_, other.data_);
  std::swap(size_, other.size_);
  return *this;
}

FeatureMap::FeatureMap(int height, int width, int channels, Number number, Margin margin)
    : height_(height),
      width_(width),
      blocks_(blocks_of(channels)),
      number_(number),
      margin_(margin),
      block_bytes_(std::size_t(margin.left + width + margin.right) * kLanes * size_of(number)),
      pages_(std::size_t(height + margin.bottom) * std::size_t(blocks_) * block_bytes_) {}

}  // namespace lightstage::model
