#include "relight/light_pack.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "core/display.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/low_rank.h"
#include "model/methods.h"
#include "model/picture_sum.h"

namespace lightstage::relight {

namespace {

constexpr double kShareOfRounding = 1.0 / 8;       // of the error
constexpr double kLargestStored = 32768;           // a power of two that half floats hold
constexpr double kFinestStored = 1.0 / (1 << 14);  // the least power of two of full precision among them

std::size_t count_masked(const core::Image& mask) {
  return std::size_t(std::count_if(mask.values().begin(), mask.values().end(), [](float m) { return m > 0.5f; }));
}

// Half floats keep 11 binary digits.
double with_half_precision(double value) {
  int exponent = 0;
  std::frexp(value, &exponent);
  return std::ldexp(std::nearbyint(std::ldexp(value, 11 - exponent)), exponent - 11);
}

double squared(std::span<const float> a) {
  double sum = 0;
  for (const float v : a) sum += double(v) * double(v);
  return sum;
}

double squared_error(std::span<const float> a, std::span<const float> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (double(a[i]) - double(b[i])) * (double(a[i]) - double(b[i]));
  return sum;
}

double squared_display_error(std::span<const float> a, std::span<const float> b, double exposure) {
  const auto shown = [&](float v) { return double(core::display_encode(float(std::clamp(v / exposure, 0.0, 1.0)))); };
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (shown(a[i]) - shown(b[i])) * (shown(a[i]) - shown(b[i]));
  return sum;
}

// Rounds unit vectors to what is stored of them. Returns for each the factor that makes it of its stored values; `vectors` become these products.
std::vector<double> round_vectors(model::RowBasis& basis, double rounding_error) {
  const double length = double(basis.length);
  // Steps of d make a mean squared error of d^2 / 12 a value; the vectors of all matter by their singular values.
  const double step_of_all = rounding_error * std::sqrt(12 * basis.total_energy / (double(basis.rank()) * length));
  const double coarsest = std::sqrt(12 / length) / 4;  // an error of a quarter of the vector: it stays what it is
  std::vector<double> factors;
  for (std::size_t k = 0; k < basis.rank(); ++k) {
    const std::span<float> vector(basis.vectors.data() + k * basis.length, basis.length);
    double largest = 0;
    for (const float v : vector) largest = std::max(largest, std::abs(double(v)));
    // Stored values run from kFinestStored, a step, to kLargestStored.
    const double step = std::max(std::min(step_of_all / std::sqrt(basis.energies[k]), coarsest),
                                 largest / kLargestStored * kFinestStored);
    const double factor = step * std::max(1.0, std::exp2(std::ceil(std::log2(largest / step / kLargestStored))));
    for (float& v : vector) v = float(with_half_precision(std::nearbyint(double(v) / step) * (step / factor)));
    factors.push_back(factor);
  }
  return factors;
}

class Compression {
 public:
  Compression(const core::OlatScan& scan, double exposure)
      // A pass over more pictures than are kept finds none of them kept.
      : scan_(scan.images_kept() >= scan.light_count() ? scan : scan.with_cache(0)),
        exposure_(exposure),
        channels_(scan.image_size().channels == 1 ? 1 : 3),
        weights_(
            core::voronoi_solid_angles(scan.directions(), std::max<std::size_t>(200000, 64 * scan.light_count()))) {}

  LightPack pack(double error) const {
    core::Progress progress("compressing", 2 * scan_.light_count());
    const model::Rows rows{scan_.light_count(), count_masked(scan_.mask()) * channels_,
                           [&](std::size_t light, std::span<float> values) {
                             const core::Image pixels = masked_pixels(*scan_.image(light), scan_.mask());
                             std::copy(pixels.values().begin(), pixels.values().end(), values.begin());
                             progress.advance();
                           }};
    model::RowBasis basis =
        model::leading_basis(rows, weights_, error * std::sqrt(1 - kShareOfRounding * kShareOfRounding));
    const std::vector<double> factors = round_vectors(basis, kShareOfRounding * error);
    return fitted(rows, basis, factors);
  }

 private:
  // The coefficients of the rounded vectors, and what the whole is worth.
  LightPack fitted(const model::Rows& rows, model::RowBasis& basis, const std::vector<double>& factors) const {
    const std::size_t rank = basis.rank();
    LightPack pack;
    for (std::size_t k = 0; k < rank; ++k) {
      core::Image picture(1, int(rows.length / channels_), int(channels_));
      float* const vector = basis.vectors.data() + k * rows.length;
      std::copy_n(vector, rows.length, picture.values().begin());
      for (std::size_t i = 0; i < rows.length; ++i) vector[i] = float(double(vector[i]) * factors[k]);
      pack.basis.push_back(std::move(picture));
    }
    struct Seen {
      double energy = 0, error = 0, display_error = 0;
    };
    std::vector<Seen> seen(rows.count);
    const std::size_t shown_every = (rows.count - 1) / 64 + 1;
    const auto see = [&](std::size_t light, std::span<const float> is, std::span<const float> becomes) {
      seen[light].energy = squared(is);
      seen[light].error = squared_error(is, becomes);
      if (light % shown_every == 0) seen[light].display_error = squared_display_error(is, becomes, exposure_);
    };
    pack.coefficients = model::fit_rows(rows, basis.vectors, rank, see);
    for (std::size_t i = 0; i < pack.coefficients.size(); ++i) pack.coefficients[i] *= factors[i % rank];

    double energy = 0, error = 0, worst = 0, display_error = 0, shown = 0, weight = 0;
    for (std::size_t light = 0; light < rows.count; ++light) {
      energy += weights_[light] * seen[light].energy;
      error += weights_[light] * seen[light].error;
      weight += weights_[light];
      worst = std::max(worst, seen[light].error);
      display_error += seen[light].display_error;
      if (light % shown_every == 0) shown += double(rows.length);
    }
    if (energy > 0)
      pack.errors = {std::sqrt(error / energy), std::sqrt(worst / (energy / weight)), std::sqrt(display_error / shown)};
    return pack;
  }

  core::OlatScan scan_;
  double exposure_;
  std::size_t channels_;
  std::vector<double> weights_;
};

}  // namespace

LightPack compress(const core::OlatScan& scan, double error, double exposure) {
  if (!(error >= kLeastPackError && error <= kMostPackError))
    throw core::UsageError("the error of a pack must lie between 0.001 and 0.5, not at " + std::to_string(error));
  if (!(exposure > 0 && std::isfinite(exposure))) throw core::UsageError("an exposure must be a positive number");
  const Compression compression(scan, exposure);
  // The errors of search, truncation and rounding are all but independent. Where they are not, the pack comes out a little worse than asked, and is made again.
  constexpr int kTries = 3;
  constexpr double kCaution = 0.98;
  LightPack pack = compression.pack(error);
  double asked = error;
  for (int tried = 1; pack.errors.relative > error && tried < kTries; ++tried) {
    asked *= kCaution * error / pack.errors.relative;
    pack = compression.pack(asked);
  }
  return pack;
}

core::Image masked_pixels(core::ImageView image, const core::Image& mask) {
  if (image.channels() != 1 && image.channels() != 3) return masked_pixels(core::to_rgb(image), mask);
  if (mask.size() != core::ImageSize{image.height(), image.width(), 1})
    throw core::BadInput("a mask is not of the size of the picture that it is for");
  core::Image pixels(1, int(count_masked(mask)), image.channels());
  float* to = pixels.values().data();
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      if (mask(y, x) > 0.5f) to = std::copy_n(image.pixel(y, x), image.channels(), to);
  return pixels;
}

core::Image unmasked(core::ImageView pixels, const core::Image& mask) {
  if (pixels.height() != 1 || std::size_t(pixels.width()) != count_masked(mask))
    throw core::BadInput("a row of " + std::to_string(pixels.width()) + " pixels does not fit into a mask of " +
                         std::to_string(count_masked(mask)));
  core::Image image(mask.height(), mask.width(), pixels.channels());
  const float* from = pixels.row(0);
  for (int y = 0; y < mask.height(); ++y)
    for (int x = 0; x < mask.width(); ++x) {
      if (!(mask(y, x) > 0.5f)) continue;
      std::copy_n(from, pixels.channels(), image.pixel(y, x));
      from += pixels.channels();
    }
  return image;
}

PackedScan::PackedScan(LightPack pack, const core::OlatScan& scan)
    : pack_(std::move(pack)),
      between_lights_(model::make_interpolator("barycentric", scan, {.domain = model::Domain::kLinear})) {
  const int pixels = int(scan.masked_pixel_count());
  for (core::Image& picture : pack_.basis) {
    if (picture.height() != 1 || picture.width() != pixels)
      throw core::BadInput("a pack of " + std::to_string(picture.width()) + " pixels is not of scan '" + scan.name() +
                           "', whose mask holds " + std::to_string(pixels));
    if (picture.channels() != 3) picture = core::to_rgb(picture);
  }
  if (pack_.coefficients.size() != pack_.rank() * scan.light_count())
    throw core::BadInput("a pack of another number of lights is not of scan '" + scan.name() + "'");
}

core::Image PackedScan::render(const core::Direction& query) const {
  std::vector<core::Vec3> colours;
  for (const double w : linear_weights(query)) colours.push_back({w, w, w});
  return lit_by(colours);
}

std::vector<double> PackedScan::linear_weights(const core::Direction& query) const {
  return between_lights_->linear_weights(query);
}

std::vector<core::Vec3> PackedScan::captured_colours(std::span<const model::DistantLight> lights) const {
  return between_lights_->captured_colours(lights);
}

core::Image PackedScan::lit_by(std::span<const core::Vec3> colours) const {
  const std::size_t lights = scan().light_count(), rank = pack_.rank();
  if (colours.size() != lights)
    throw core::BadInput("scan '" + scan().name() + "' has " + std::to_string(lights) + " lights, not " +
                         std::to_string(colours.size()));
  std::vector<core::Vec3> of_basis(rank);
  core::parallel_for(rank, 16, [&](std::size_t first, std::size_t last) {
    for (std::size_t light = 0; light < lights; ++light)
      for (std::size_t k = first; k < last; ++k)
        of_basis[k] = of_basis[k] + pack_.coefficients[light * rank + k] * colours[light];
  });
  model::PictureSum sum({1, int(scan().masked_pixel_count()), 3});
  sum.add(pack_.basis, of_basis);
  return unmasked(sum.result(), scan().mask());
}

}  // namespace lightstage::relight
