#include "model/picture_sum.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>

#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::model {

namespace {

// Factors repeat with this period along the values of a picture: a multiple of 1 to 4 channels, and long
// enough for the compiler to use whole vector registers.
constexpr std::size_t kPeriod = 12;
// Values whose sums (24 KiB) stay in the first-level cache while all pictures pass by; a multiple of the
// period, so that every block starts at the first channel.
constexpr std::size_t kBlock = 256 * kPeriod;
// Pictures that pass by at once: the sums travel to memory and back once for so many pictures.
constexpr std::size_t kGroup = 16;

using Factors = std::array<double, kPeriod>;

Factors factors_of(double weight) {
  Factors factors;
  factors.fill(weight);
  return factors;
}

Factors factors_of(core::Vec3 colour) {
  Factors factors;
  for (std::size_t i = 0; i < kPeriod; i += 3) {
    factors[i] = colour.x;
    factors[i + 1] = colour.y;
    factors[i + 2] = colour.z;
  }
  return factors;
}

// Adds K pictures in one pass over the sums: memory then serves several streams at once, which is twice as fast as one.
// Every sum still takes its pictures one after the other.
template <std::size_t K>
void add_block(double* sums, std::size_t count, const float* const* values, const Factors* factors) {
  std::array<Factors, K> f;  // local copies cannot alias the sums
  std::array<const float*, K> v;
  std::copy_n(factors, K, f.begin());
  std::copy_n(values, K, v.begin());
  const auto add_at = [&](std::size_t i, std::size_t j) {
    double sum = sums[i];
    for (std::size_t k = 0; k < K; ++k) sum += f[k][j] * double(v[k][i]);
    sums[i] = sum;
  };
  std::size_t i = 0;
  for (; i + kPeriod <= count; i += kPeriod)
    for (std::size_t j = 0; j < kPeriod; ++j) add_at(i + j, j);
  for (std::size_t j = 0; i < count; ++i, ++j) add_at(i, j);
}

std::string text_of(core::ImageSize size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height) + "x" + std::to_string(size.channels);
}

bool is_zero(double weight) {
  return weight == 0;
}
bool is_zero(core::Vec3 colour) {
  return colour == core::Vec3{};
}
bool is_finite(double weight) {
  return std::isfinite(weight);
}
bool is_finite(core::Vec3 c) {
  return std::isfinite(c.x) && std::isfinite(c.y) && std::isfinite(c.z);
}

// The image in the form that a weight or a colour multiplies.
std::shared_ptr<const core::Image> picture_for(double, const core::OlatScan& scan, std::size_t light) {
  return scan.image(light);
}
std::shared_ptr<const core::Image> picture_for(core::Vec3, const core::OlatScan& scan, std::size_t light) {
  std::shared_ptr<const core::Image> image = scan.image(light);
  return image->channels() == 3 ? image : std::make_shared<const core::Image>(core::to_rgb(*image));
}

}  // namespace

struct PictureSum::Terms {
  std::vector<const core::Image*> pictures;
  std::vector<Factors> factors;
};

PictureSum::PictureSum(core::ImageSize size) : size_(size), sums_(size.value_count()) {
  if (sums_.empty()) throw core::BadInput("a sum of pictures of " + text_of(size) + " has no values");
}

void PictureSum::add(const Terms& terms) {
  for (const core::Image* picture : terms.pictures)
    if (picture->size() != size_)
      throw core::BadInput("a picture of " + text_of(picture->size()) + " cannot be added to a sum of " +
                           text_of(size_));
  const std::size_t block_count = (sums_.size() - 1) / kBlock + 1;
  core::parallel_for(block_count, 4, [&](std::size_t first, std::size_t last) {
    std::vector<const float*> values(terms.pictures.size());
    for (std::size_t block = first; block < last; ++block) {
      const std::size_t start = block * kBlock;
      const std::size_t count = std::min(kBlock, sums_.size() - start);
      double* const sums = sums_.data() + start;
      for (std::size_t k = 0; k < values.size(); ++k) values[k] = terms.pictures[k]->values().data() + start;
      std::size_t k = 0;
      for (; k + 4 <= values.size(); k += 4) add_block<4>(sums, count, &values[k], &terms.factors[k]);
      for (; k < values.size(); ++k) add_block<1>(sums, count, &values[k], &terms.factors[k]);
    }
  });
}

void PictureSum::add(const core::Image& picture, core::Vec3 colour) {
  if (size_.channels != 3 || !is_finite(colour))
    throw core::BadInput("a coloured light needs a sum of 3 channels and finite colours");
  add(Terms{{&picture}, {factors_of(colour)}});
}

void PictureSum::add(std::span<const core::Image> pictures, std::span<const core::Vec3> colours) {
  if (size_.channels != 3 || pictures.size() != colours.size() ||
      !std::all_of(colours.begin(), colours.end(), [](core::Vec3 c) { return is_finite(c); }))
    throw core::BadInput("coloured lights need a sum of 3 channels and a finite colour a picture");
  for (std::size_t start = 0; start < pictures.size(); start += kGroup) {
    Terms terms;
    for (std::size_t i = start; i < std::min(start + kGroup, pictures.size()); ++i) {
      terms.pictures.push_back(&pictures[i]);
      terms.factors.push_back(factors_of(colours[i]));
    }
    add(terms);
  }
}

template <class Weight>
void PictureSum::add_scan(const core::OlatScan& scan, std::span<const Weight> weights) {
  if (weights.size() != scan.light_count())
    throw core::BadInput("scan '" + scan.name() + "' has " + std::to_string(scan.light_count()) + " lights, not " +
                         std::to_string(weights.size()));
  std::vector<std::size_t> lights;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (!is_finite(weights[i]))
      throw core::BadInput("scan '" + scan.name() + "': the weight of light " + std::to_string(i) + " is not finite");
    if (!is_zero(weights[i])) lights.push_back(i);
  }
  for (std::size_t start = 0; start < lights.size(); start += kGroup) {
    const std::size_t count = std::min(kGroup, lights.size() - start);
    std::vector<std::shared_ptr<const core::Image>> pictures(count);
    core::parallel_for(count, 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) pictures[i] = picture_for(Weight{}, scan, lights[start + i]);
    });
    Terms terms;
    for (std::size_t i = 0; i < count; ++i) {
      terms.pictures.push_back(pictures[i].get());
      terms.factors.push_back(factors_of(weights[lights[start + i]]));
    }
    add(terms);
  }
}

void PictureSum::add(const core::OlatScan& scan, std::span<const double> weights) {
  add_scan(scan, weights);
}

void PictureSum::add(const core::OlatScan& scan, std::span<const core::Vec3> colours) {
  if (size_.channels != 3) throw core::BadInput("coloured lights need a sum of 3 channels");
  add_scan(scan, colours);
}

core::Image PictureSum::result() const {
  core::Image image(size_);
  core::parallel_for(sums_.size(), kBlock, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) image.values()[i] = static_cast<float>(sums_[i]);
  });
  return image;
}

}  // namespace lightstage::model
