#include "align/hidden.h"

#include <cmath>
#include <limits>

#include "core/error.h"

namespace lightstage::align {

namespace {

bool inside(core::ImageView mask, int y, int x) {
  return mask.empty() || mask(y, x) > 0.5F;
}

void require_size(core::ImageView image, core::ImageSize size, const std::string& what) {
  if (image.height() == size.height && image.width() == size.width) return;
  throw core::BadInput("hidden pixels: " + what + " is of another size");
}

}  // namespace

double hidden_weight(const core::Direction& light, const core::Direction& other) {
  constexpr double kSofteningRadians = 0.01;  // two lights in one place do not silence the others
  return 1 / (core::angle_radians(light, other) + kSofteningRadians);
}

HiddenPixels::HiddenPixels(core::ImageView confidence, core::ImageView mask) : size_(confidence.size()) {
  if (!mask.empty()) require_size(mask, size_, "the mask");
  if (confidence.channels() != 1 || size_.value_count() > std::numeric_limits<std::uint32_t>::max()) {
    throw core::BadInput("hidden pixels: a confidence has one channel");
  }
  for (int y = 0; y < size_.height; ++y) {
    for (int x = 0; x < size_.width; ++x) {
      if (!inside(mask, y, x)) continue;
      ++subject_;
      if (!(confidence(y, x) > 0)) places_.push_back(std::uint32_t(y) * std::uint32_t(size_.width) + std::uint32_t(x));
    }
  }
}

void HiddenPixels::add(core::ImageView picture, core::ImageView confidence, core::ImageView other,
                       core::ImageView other_confidence, core::ImageView mask, double weight) {
  for (const core::ImageView image : {picture, confidence, other, other_confidence})
    require_size(image, size_, "a picture");
  if (picture.channels() != other.channels()) throw core::BadInput("hidden pixels: grey and colour pictures");
  if (!(weight > 0) || !std::isfinite(weight)) throw core::BadInput("hidden pixels: a weight must be positive");
  if (places_.empty()) return;
  const std::size_t channels = std::size_t(picture.channels());
  sums_.resize(places_.size() * channels);
  weights_.resize(places_.size());
  std::vector<double> own(channels), others(channels);
  for (int y = 0; y < size_.height; ++y) {
    for (int x = 0; x < size_.width; ++x) {
      if (!inside(mask, y, x) || !(confidence(y, x) > 0) || !(other_confidence(y, x) > 0)) continue;
      for (std::size_t c = 0; c < channels; ++c) {
        own[c] += double(picture(y, x, int(c)));
        others[c] += double(other(y, x, int(c)));
      }
    }
  }
  for (std::size_t c = 0; c < channels; ++c) {
    if (!(others[c] > 0)) return;  // a black picture tells nothing of what it would look like under this light
  }
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const int y = int(places_[i] / std::uint32_t(size_.width)), x = int(places_[i] % std::uint32_t(size_.width));
    if (!(other_confidence(y, x) > 0)) continue;
    for (std::size_t c = 0; c < channels; ++c) {
      sums_[i * channels + c] += weight * std::max(0.0, own[c] / others[c]) * double(other(y, x, int(c)));
    }
    weights_[i] += weight;
  }
}

void HiddenPixels::fill(core::Image& picture, core::Image& seen) const {
  require_size(picture, size_, "the picture");
  require_size(seen, size_, "what is seen");
  const std::size_t channels = std::size_t(picture.channels());
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const int y = int(places_[i] / std::uint32_t(size_.width)), x = int(places_[i] % std::uint32_t(size_.width));
    const bool shown = !weights_.empty() && weights_[i] > 0;
    for (std::size_t c = 0; c < channels; ++c) {
      picture(y, x, int(c)) = shown ? float(sums_[i * channels + c] / weights_[i]) : 0;
    }
    if (!shown) seen(y, x) = 0;
  }
}

}  // namespace lightstage::align
