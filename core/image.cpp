#include "core/image.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::core {

namespace {

constexpr std::size_t kRowsAtATime = 16;

std::string text_of(ImageSize size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height) + " with " + std::to_string(size.channels) +
         " channels";
}

ImageSize checked(ImageSize size) {
  if (size.height < 0 || size.width < 0 || size.channels < 0) throw BadInput("an image cannot be " + text_of(size));
  // In float64 the product of three ints cannot overflow.
  if (double(size.height) * double(size.width) * double(size.channels) > 0x1p40)
    throw BadInput("an image of " + text_of(size) + " is too large");
  return size;
}

// Calls body(y) for every row, several rows to a thread.
template <class Body>
void for_each_row(int height, const Body& body) {
  parallel_for(std::size_t(height), kRowsAtATime, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y) body(static_cast<int>(y));
  });
}

// What one image gives to a block of a weighted sum.
struct Addend {
  const float* values;
  double weight;
};

// sums[v] += weight * values[v] of every addend, in their order. Four at a time, because loading and storing the
// sums once for each image takes twice as long; the additions are the same ones.
void add_all(std::span<const Addend> addends, std::span<double> sums) {
  while (addends.size() >= 4) {
    const Addend a = addends[0], b = addends[1], c = addends[2], d = addends[3];
    for (std::size_t v = 0; v < sums.size(); ++v)
      sums[v] = sums[v] + a.weight * double(a.values[v]) + b.weight * double(b.values[v]) +
                c.weight * double(c.values[v]) + d.weight * double(d.values[v]);
    addends = addends.subspan(4);
  }
  for (const Addend& a : addends)
    for (std::size_t v = 0; v < sums.size(); ++v) sums[v] += a.weight * double(a.values[v]);
}

}  // namespace

Image::Image(ImageSize size) : size_(checked(size)), values_(size.value_count()) {}

Image::Image(ImageView view) : size_(view.size()) {
  values_.reserve(size_.value_count());
  const std::size_t row_length = row_stride();
  if (row_length == 0) return;
  for (int y = 0; y < size_.height; ++y) values_.insert(values_.end(), view.row(y), view.row(y) + row_length);
}

Image to_rgb(ImageView image) {
  if (image.channels() < 1 || image.channels() > 4)
    throw BadInput("an image of " + text_of(image.size()) + " has no RGB form");
  const bool grey = image.channels() <= 2;
  Image result(image.height(), image.width(), 3);
  for_each_row(image.height(), [&](int y) {
    for (int x = 0; x < image.width(); ++x)
      for (int c = 0; c < 3; ++c) result(y, x, c) = image(y, x, grey ? 0 : c);
  });
  return result;
}

Image to_luminance(ImageView image) {
  if (image.channels() < 1 || image.channels() > 4)
    throw BadInput("an image of " + text_of(image.size()) + " has no luminance");
  const bool grey = image.channels() <= 2;
  Image result(image.height(), image.width(), 1);
  for_each_row(image.height(), [&](int y) {
    for (int x = 0; x < image.width(); ++x) {
      const float* p = image.pixel(y, x);
      // ITU-R BT.709-6, item 3.2.
      result(y, x) = grey ? p[0] : static_cast<float>(0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]);
    }
  });
  return result;
}

Image shrink_by_box(ImageView image, int factor) {
  if (factor < 1) throw BadInput("an image cannot be shrunk by a factor of " + std::to_string(factor));
  if (image.empty()) return Image(image.size());
  const int height = (image.height() - 1) / factor + 1;
  const int width = (image.width() - 1) / factor + 1;
  const int channels = image.channels();
  Image result(height, width, channels);
  for_each_row(height, [&](int y) {
    // 64-bit, because the box of a huge factor may end beyond what an int holds.
    const int y_end = int(std::min<std::int64_t>(image.height(), (std::int64_t(y) + 1) * factor));
    std::vector<double> sums(std::size_t(width) * std::size_t(channels));
    for (int from_y = y * factor; from_y < y_end; ++from_y)
      for (int x = 0; x < image.width(); ++x)
        for (int c = 0; c < channels; ++c)
          sums[std::size_t(x / factor) * std::size_t(channels) + std::size_t(c)] += image(from_y, x, c);
    for (int x = 0; x < width; ++x) {
      const int x_end = int(std::min<std::int64_t>(image.width(), (std::int64_t(x) + 1) * factor));
      const double area = double(y_end - y * factor) * double(x_end - x * factor);
      for (int c = 0; c < channels; ++c)
        result(y, x, c) = static_cast<float>(sums[std::size_t(x) * std::size_t(channels) + std::size_t(c)] / area);
    }
  });
  return result;
}

Image weighted_sum(std::span<const ImageView> images, std::span<const double> weights) {
  if (images.empty()) throw BadInput("a weighted sum needs at least one image");
  if (images.size() != weights.size())
    throw BadInput("a weighted sum of " + std::to_string(images.size()) + " images got " +
                   std::to_string(weights.size()) + " weights");
  const ImageSize size = images.front().size();
  bool contiguous = true;
  for (std::size_t i = 0; i < images.size(); ++i) {
    if (images[i].size() != size)
      throw BadInput("a weighted sum needs images of one size: image 0 is " + text_of(size) + ", image " +
                     std::to_string(i) + " is " + text_of(images[i].size()));
    if (!std::isfinite(weights[i])) throw BadInput("weight " + std::to_string(i) + " of a sum is not finite");
    contiguous = contiguous && images[i].contiguous();
  }
  Image result(size);
  if (result.empty()) return result;

  // Blocks of values whose sums stay in the second-level cache while all images pass by. Without gaps between
  // rows the image is one long row.
  constexpr std::size_t kBlock = 8192;
  const std::size_t row_count = contiguous ? 1 : std::size_t(size.height);
  const std::size_t row_length = size.value_count() / row_count;
  const std::size_t blocks_per_row = (row_length - 1) / kBlock + 1;
  parallel_for(row_count * blocks_per_row, 1, [&](std::size_t block, std::size_t) {
    const std::size_t row = block / blocks_per_row;
    const std::size_t start = block % blocks_per_row * kBlock;
    std::vector<double> sums(std::min(kBlock, row_length - start));
    std::vector<Addend> addends;
    for (std::size_t i = 0; i < images.size(); ++i)
      if (weights[i] != 0) addends.push_back({images[i].row(static_cast<int>(row)) + start, weights[i]});
    add_all(addends, sums);
    std::transform(sums.begin(), sums.end(), result.values().data() + row * row_length + start,
                   [](double sum) { return static_cast<float>(sum); });
  });
  return result;
}

double quantile(std::span<const float> values, double q) {
  if (values.empty()) throw BadInput("a quantile needs at least one value");
  if (!(q >= 0 && q <= 1)) throw BadInput("a quantile's position must lie in [0, 1]");
  std::vector<float> copy(values.begin(), values.end());
  const double position = q * double(copy.size() - 1);
  const std::size_t below = static_cast<std::size_t>(position);
  const auto at = copy.begin() + std::ptrdiff_t(below);
  std::nth_element(copy.begin(), at, copy.end());
  if (at + 1 == copy.end()) return *at;
  return std::lerp(double(*at), double(*std::min_element(at + 1, copy.end())), position - double(below));
}

}  // namespace lightstage::core
