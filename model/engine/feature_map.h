// Where the engine keeps feature maps.
#pragma once

#include <cstddef>
#include <span>

#include "model/engine/kernels.h"

namespace lightstage::model {

// Memory by whole pages, zeroed, large ones where the system has them; or a file as memory. Moves, but does not copy.
class Pages {
 public:
  Pages() = default;
  // Throws core::Error when there is not so much memory.
  explicit Pages(std::size_t bytes);
  // Part of a file, read only, from a multiple of the page size. Throws as above.
  Pages(int file, std::size_t offset, std::size_t bytes);
  ~Pages();
  Pages(Pages&& other) noexcept;
  Pages& operator=(Pages&& other) noexcept;

  std::byte* data() const { return data_; }
  std::size_t size() const { return size_; }

 private:
  std::byte* data_ = nullptr;
  std::size_t size_ = 0;
};

// Pixel 0 of block 0 of a row.
struct ConstRow {
  const std::byte* data;
  std::size_t block_bytes;
};
struct Row {
  std::byte* data;
  std::size_t block_bytes;
  operator ConstRow() const { return {data, block_bytes}; }
};

// Zeros around a map that convolutions may read.
struct Margin {
  int left = 0, right = 0, bottom = 0;
};

// [row][block][pixel][16], see model/engine/kernels.h. All zero when made.
class FeatureMap {
 public:
  FeatureMap() = default;
  FeatureMap(int height, int width, int channels, Number number, Margin margin = {});
  // Without numbers.
  static FeatureMap shape(int height, int width, int channels, Number number, Margin margin = {});
  // A map of the same shape on other pages.
  FeatureMap(const FeatureMap& shape, Pages pages);
  // Zeros for a map that is a shape alone; nothing for another.
  void allocate();
  // Keeps the shape.
  void release() { pages_ = Pages(); }

  int height() const { return height_; }
  int width() const { return width_; }
  int blocks() const { return blocks_; }
  Number number() const { return number_; }
  std::size_t pixel_bytes() const { return kLanes * size_of(number_); }
  std::size_t bytes() const { return std::size_t(height_ + margin_.bottom) * std::size_t(blocks_) * block_bytes_; }
  const std::byte* data() const { return pages_.data(); }
  // y up to height() - 1 + bottom margin; pixels from -left to width() - 1 + right.
  Row row(int y) const {
    return {pages_.data() + std::size_t(y) * std::size_t(blocks_) * block_bytes_ +
                std::size_t(margin_.left) * pixel_bytes(),
            block_bytes_};
  }

 private:
  int height_ = 0, width_ = 0, blocks_ = 0;
  Number number_ = Number::kFloat32;
  Margin margin_;
  std::size_t block_bytes_ = 0;
  Pages pages_;
};

constexpr int blocks_of(int channels) {
  return (channels + kLanes - 1) / kLanes;
}

}  // namespace lightstage::model
