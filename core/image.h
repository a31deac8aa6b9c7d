// Images as every room sees them: float32, rows of pixels of interleaved channels (HWC, which is torch
// channels_last), linear scene-referred with Rec. 709 primaries unless a name says otherwise.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace lightstage::core {

struct ImageSize {
  int height = 0, width = 0, channels = 0;
  friend bool operator==(const ImageSize&, const ImageSize&) = default;
  std::size_t value_count() const { return std::size_t(height) * std::size_t(width) * std::size_t(channels); }
};

// A window into pixels owned by somebody else; `row_stride` counts floats from one row's start to the next.
// Copying a view copies no pixels. A view must not outlive its owner.
template <class T>
class BasicImageView {
 public:
  BasicImageView() = default;
  BasicImageView(T* data, ImageSize size, std::size_t row_stride) : data_(data), size_(size), row_stride_(row_stride) {}

  ImageSize size() const { return size_; }
  int height() const { return size_.height; }
  int width() const { return size_.width; }
  int channels() const { return size_.channels; }
  std::size_t row_stride() const { return row_stride_; }
  bool empty() const { return size_.value_count() == 0; }
  bool contiguous() const { return row_stride_ == std::size_t(size_.width) * std::size_t(size_.channels); }

  T* row(int y) const { return data_ + std::size_t(y) * row_stride_; }
  T* pixel(int y, int x) const { return row(y) + std::size_t(x) * std::size_t(size_.channels); }
  T& operator()(int y, int x, int c = 0) const { return pixel(y, x)[c]; }

  // The rectangle of `height` x `width` pixels whose top left corner is (y, x); must lie inside.
  BasicImageView crop(int y, int x, int height, int width) const {
    return BasicImageView(pixel(y, x), ImageSize{height, width, size_.channels}, row_stride_);
  }

 private:
  T* data_ = nullptr;
  ImageSize size_;
  std::size_t row_stride_ = 0;
};

using ImageView = BasicImageView<const float>;
using MutableImageView = BasicImageView<float>;

// Owns its pixels, contiguous. Freshly made images are all zero.
class Image {
 public:
  Image() = default;
  // Throws BadInput for negative sizes or more than 2^40 values.
  explicit Image(ImageSize size);
  Image(int height, int width, int channels) : Image(ImageSize{height, width, channels}) {}
  // A copy of what the view shows.
  explicit Image(ImageView view);

  ImageSize size() const { return size_; }
  int height() const { return size_.height; }
  int width() const { return size_.width; }
  int channels() const { return size_.channels; }
  bool empty() const { return values_.empty(); }

  std::span<float> values() { return values_; }
  std::span<const float> values() const { return values_; }
  float* pixel(int y, int x) { return values_.data() + offset(y, x); }
  const float* pixel(int y, int x) const { return values_.data() + offset(y, x); }
  float& operator()(int y, int x, int c = 0) { return pixel(y, x)[c]; }
  float operator()(int y, int x, int c = 0) const { return pixel(y, x)[c]; }

  operator ImageView() const { return {values_.data(), size_, row_stride()}; }
  ImageView view() const { return *this; }
  MutableImageView mutable_view() { return {values_.data(), size_, row_stride()}; }

  friend bool operator==(const Image&, const Image&) = default;

 private:
  std::size_t row_stride() const { return std::size_t(size_.width) * std::size_t(size_.channels); }
  std::size_t offset(int y, int x) const {
    return (std::size_t(y) * std::size_t(size_.width) + std::size_t(x)) * std::size_t(size_.channels);
  }
  ImageSize size_;
  std::vector<float> values_;
};

// The image with 3 channels: grey is repeated, alpha (a fourth or second channel) is dropped.
Image to_rgb(ImageView image);
// Rec. 709 luminance, one channel; a grey image is copied.
Image to_luminance(ImageView image);
// The mean over whole boxes of `factor` x `factor` pixels; sizes are rounded up and the last boxes may be
// smaller.
Image shrink_by_box(ImageView image, int factor);

// Weighted sum of images of one size, in float64, in a fixed order: the result is the same for every thread
// count. Pixels of images whose weight is exactly 0 are not read. Throws BadInput when sizes differ.
Image weighted_sum(std::span<const ImageView> images, std::span<const double> weights);

// The q-quantile (q in [0, 1], linear between order statistics) of the values; all values must be finite.
// Throws BadInput for an empty span. O(n), reorders a copy.
double quantile(std::span<const float> values, double q);

}  // namespace lightstage::core
