#include "sim/sensor.h"

#include <algorithm>

#include "core/error.h"
#include "core/parallel.h"
#include "sim/devices/poisson.h"
#include "sim/scene/random.h"

namespace lightstage::sim {

namespace {

constexpr std::size_t kRowGrain = 16;
// In full scales; what is brighter counts as this bright, so that infinite radiance does no harm.
constexpr double kBrightest = 1e6;

double seconds(core::Nanoseconds time) {
  return static_cast<double>(time) * 1e-9;
}

void check(core::ImageView radiance, const SensorSpec& spec, double responsivity, core::Nanoseconds exposure) {
  const auto require = [](bool condition, const char* problem) {
    if (!condition) throw core::BadInput(std::string("simulated sensor: ") + problem);
  };
  require(radiance.channels() == 3 || (radiance.channels() == 1 && !spec.bayer),
          "the picture must have 3 channels (or 1 without Bayer mosaic)");
  require(spec.bits >= 1 && spec.bits <= 24, "bits must be 1 to 24");
  require(spec.full_well_electrons > 0, "full_well_electrons must be above 0");
  require(spec.read_noise_electrons >= 0, "read_noise_electrons must not be negative");
  require(spec.vignetting >= 0 && spec.vignetting <= 1, "vignetting must be 0 to 1");
  require(exposure > 0 && responsivity > 0, "exposure and responsivity must be above 0");
}

// Which of R, G, B the mosaic's pixel sees.
int bayer_channel(int y, int x) {
  return (y & 1) + (x & 1);
}

// From signal in full scales to what the converter gives, in full scales.
class Converter {
 public:
  Converter(const SensorSpec& spec, std::uint64_t noise_seed)
      : spec_(spec), shot_seed_(mix(noise_seed, 0)), read_seed_(mix(noise_seed, 1)) {}

  // `sample` counts the measured values of the image.
  double convert(double signal, std::uint64_t sample) const {
    if (!spec_.noise) return std::min(signal, 1.0);
    const double electrons = poisson(signal * spec_.full_well_electrons, shot_seed_, sample) +
                             spec_.read_noise_electrons * normal(read_seed_, sample);
    return quantise(electrons / spec_.full_well_electrons);
  }

 private:
  double quantise(double signal) const {
    const double code = std::round(black_ + signal * (top_ - black_));
    return (std::clamp(code, 0.0, top_) - black_) / (top_ - black_);
  }

  const SensorSpec& spec_;
  std::uint64_t shot_seed_, read_seed_;
  double top_ = std::exp2(spec_.bits) - 1;
  double black_ = std::floor(std::exp2(spec_.bits) / 64);
};

// Squared distance from the image centre in units of that of the corner, which is the corner pixel's outer
// corner.
class Vignetting {
 public:
  Vignetting(double loss, core::ImageSize size) : loss_(loss), height_(size.height), width_(size.width) {}
  double gain(int y, int x) const {
    const double dy = 2 * y + 1 - height_, dx = 2 * x + 1 - width_;
    return 1 - loss_ * (dy * dy + dx * dx) / (height_ * height_ + width_ * width_);
  }

 private:
  double loss_, height_, width_;
};

// The mean of the pixels of one colour nearest to (y, x): itself, or those in the 3x3 window. An image too
// small to hold the colour there answers with the pixel itself.
float demosaic(core::ImageView mosaic, int y, int x, int channel) {
  if (bayer_channel(y, x) == channel) return mosaic(y, x);
  double sum = 0;
  int count = 0;
  for (int v = std::max(0, y - 1); v <= std::min(mosaic.height() - 1, y + 1); ++v) {
    for (int u = std::max(0, x - 1); u <= std::min(mosaic.width() - 1, x + 1); ++u) {
      if (bayer_channel(v, u) != channel) continue;
      sum += static_cast<double>(mosaic(v, u));
      ++count;
    }
  }
  return count > 0 ? static_cast<float>(sum / count) : mosaic(y, x);
}

void for_rows(int height, const std::function<void(int)>& row) {
  core::parallel_for(static_cast<std::size_t>(height), kRowGrain, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y) row(static_cast<int>(y));
  });
}

}  // namespace

double saturation_radiance(double responsivity, core::Nanoseconds exposure) {
  return 1 / (responsivity * seconds(exposure));
}

core::Image sense(core::ImageView radiance, const SensorSpec& spec, double responsivity, core::Nanoseconds exposure,
                  std::uint64_t noise_seed) {
  check(radiance, spec, responsivity, exposure);
  const core::ImageSize size = radiance.size();
  const double saturation = saturation_radiance(responsivity, exposure);
  const Vignetting vignetting(spec.vignetting, size);
  const Converter converter(spec, noise_seed);

  const int measured_channels = spec.bayer ? 1 : size.channels;
  core::Image measured(size.height, size.width, measured_channels);
  for_rows(size.height, [&](int y) {
    auto sample = static_cast<std::uint64_t>(y) * static_cast<std::uint64_t>(size.width * measured_channels);
    for (int x = 0; x < size.width; ++x) {
      for (int c = 0; c < measured_channels; ++c, ++sample) {
        const double light = std::max(0.0f, radiance(y, x, spec.bayer ? bayer_channel(y, x) : c));
        const double signal = std::min(light / saturation * vignetting.gain(y, x), kBrightest);
        measured(y, x, c) = static_cast<float>(converter.convert(signal, sample) * saturation);
      }
    }
  });
  if (!spec.bayer) return measured;

  core::Image picture(size);
  for_rows(size.height, [&](int y) {
    for (int x = 0; x < size.width; ++x) {
      for (int c = 0; c < 3; ++c) picture(y, x, c) = demosaic(measured, y, x, c);
    }
  });
  return picture;
}

}  // namespace lightstage::sim
