#include "model/normals.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "core/interrupt.h"
#include "core/parallel.h"
#include "model/classical/lambertian_fit.h"

namespace lightstage::model {

namespace {

// Whole rows of all images, so that a pixel's values under all lights lie side by side.
class Band {
 public:
  Band(const core::OlatScan& scan, int first_row, int rows)
      : size_{rows, scan.image_size().width, scan.image_size().channels},
        lights_(scan.light_count()),
        values_(size_.value_count() * lights_) {
    core::parallel_for(lights_, 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t light = first; light < last; ++light) {
        const auto image = scan.image(light);
        const float* source = image->pixel(first_row, 0);
        for (std::size_t v = 0; v < size_.value_count(); ++v) values_[v * lights_ + light] = source[v];
      }
    });
  }

  std::span<const float> values(int row, int x, int channel) const {
    const std::size_t at = (std::size_t(row) * std::size_t(size_.width) + std::size_t(x)) * std::size_t(size_.channels);
    return {values_.data() + (at + std::size_t(channel)) * lights_, lights_};
  }

 private:
  core::ImageSize size_;
  std::size_t lights_;
  std::vector<float> values_;
};

int rows_at_a_time(const core::OlatScan& scan) {
  constexpr std::size_t kBytes = std::size_t(1) << 30;
  const core::ImageSize size = scan.image_size();
  const std::size_t row =
      core::ImageSize{1, size.width, size.channels}.value_count() * scan.light_count() * sizeof(float);
  return int(std::clamp<std::size_t>(kBytes / row, 1, std::size_t(size.height)));
}

// The albedo that fits the values best, given the normal.
double albedo_along(core::Vec3 normal, const std::vector<core::Direction>& lights, std::span<const float> values,
                    std::span<const double> weights) {
  double product = 0, square = 0;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    if (weights[i] == 0) continue;
    const double cosine = dot(normal, lights[i].vec());
    product += weights[i] * cosine * double(values[i]);
    square += weights[i] * cosine * cosine;
  }
  constexpr double kLargest = std::numeric_limits<float>::max();
  return square > 0 ? std::clamp(product / square, 0.0, kLargest) : 0;
}

}  // namespace

SurfaceMaps estimate_normals(const core::OlatScan& scan) {
  const core::ImageSize size = scan.image_size();
  const LambertianFitter fitter(scan.directions());
  SurfaceMaps maps{core::Image(size.height, size.width, 3), core::Image(size), core::Image(size.height, size.width, 1),
                   core::Image(size.height, size.width, 1)};
  const int rows = rows_at_a_time(scan);
  for (int top = 0; top < size.height; top += rows) {
    const int count = std::min(rows, size.height - top);
    const Band band(scan, top, count);
    const auto fit_pixels = [&](std::size_t first, std::size_t last) {
      std::vector<double> weights(scan.light_count());
      std::vector<float> brightness(scan.light_count());
      for (std::size_t pixel = first; pixel < last; ++pixel) {
        const int row = int(pixel / std::size_t(size.width)), x = int(pixel % std::size_t(size.width)), y = top + row;
        std::fill(brightness.begin(), brightness.end(), 0.0F);
        for (int c = 0; c < size.channels; ++c) {
          const std::span<const float> values = band.values(row, x, c);
          for (std::size_t i = 0; i < values.size(); ++i) brightness[i] += values[i] / float(size.channels);
        }
        const LambertianFit fit = fitter(brightness, weights);
        const double length = norm(fit.scaled_normal);
        const core::Vec3 normal = length > 0 ? fit.scaled_normal / length : core::Vec3{0, 0, 1};
        maps.normals(y, x, 0) = float(normal.x);
        maps.normals(y, x, 1) = float(normal.y);
        maps.normals(y, x, 2) = float(normal.z);
        for (int c = 0; c < size.channels; ++c)
          maps.albedo(y, x, c) = float(albedo_along(normal, scan.directions(), band.values(row, x, c), weights));
        maps.confidence(y, x) = float(fit.share / fit.condition);
        maps.condition(y, x) = float(fit.condition);
      }
    };
    constexpr std::size_t kGrain = 64, kAtATime = 4096;  // pixels; between them Ctrl-C is heeded
    const std::size_t pixels = std::size_t(count) * std::size_t(size.width);
    for (std::size_t done = 0; done < pixels; done += kAtATime) {
      core::throw_if_interrupted();
      core::parallel_for(std::min(kAtATime, pixels - done), kGrain,
                         [&](std::size_t first, std::size_t last) { fit_pixels(done + first, done + last); });
    }
  }
  return maps;
}

}  // namespace lightstage::model
