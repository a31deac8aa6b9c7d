// Bracketed exposures of one still scene as one image: high dynamic range.
#pragma once

#include <cstddef>
#include <span>

#include "core/image.h"

namespace lightstage::core {

// One exposure by a linear sensor. Values are radiance (signal over responsivity and time), so that all exposures of a scene
// agree but for noise.
struct Exposure {
  ImageView image;
  double seconds = 0;
  double saturation = 0;  // the value at which the sensor clips, before the dark frame is taken off; 0: not known
  ImageView dark;         // what the camera sees of no light in as long a time; empty: nothing is taken off
};

// The signal at which the variances of shot noise and read noise are equal, over the signal at which the sensor clips: read noise squared over
// full well, both in electrons. 0.0006 for 2.5 electrons of 10500; cameras lie between 0.0003 and 0.005, and a value wrong by four times
// costs less than 2 % of the noise (tests/core/exposure_merge_test.cpp).
inline constexpr double kUsualReadNoiseShare = 0.001;

struct MergedExposures {
  Image image;
  Image saturated;                   // one channel: 1 where a channel saturates in all exposures
  std::size_t saturated_values = 0;  // how many values (pixels times channels) do
};

// The mean of the exposures, less their dark frames, by weights that make its variance least (Granados et al. 2010, "Optimal HDR reconstruction
// with linear digital cameras", equation 6): an exposure of time t that clips at s has variance (radiance + read_noise_share * s) / t. The
// radiance in the weights is the mean weighted by the squares of the times: what noise of short, dark exposures got into it would weigh them
// by their own noise, a bias. Negative noise is kept.
// A value loses its weight smoothly from 0.8 to 0.95 of saturation (sensors leave linearity before they clip, and a hard limit on a noisy value
// would prefer the dark ones), channel by channel. One that no exposure shows below that is taken from the exposure that saturates last, and
// marked. Exposures may be in any order and repeated; where one's saturation is not known they are weighted by time alone.
// Throws BadInput, naming the exposure by its place, for none, sizes that differ, times that are not positive, and values that are not finite.
// O(pixels times exposures), on all threads.
MergedExposures merge_exposures(std::span<const Exposure> exposures, double read_noise_share = kUsualReadNoiseShare);

}  // namespace lightstage::core
