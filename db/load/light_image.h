// From stored values to radiance per unit light.
#pragma once

#include <array>
#include <span>

#include "core/image.h"

namespace lightstage::db {

// image - dark; an empty `dark` changes nothing. Throws StoreError when the sizes differ.
void subtract_dark(core::Image& image, core::ImageView dark);

// Each channel divided by the light's gain in it; a grey image by the mean of the gains.
void divide_by_gain(core::Image& image, const std::array<double, 3>& gain);

// One exposure of a light: values are radiance, reliable below `saturation` (0: everywhere).
struct Exposure {
  core::Image image;
  double seconds = 0;
  double saturation = 0;
};

// Several exposures of one light as one image: the mean of the values that are not near saturation, weighted
// by exposure time, as photons are counted (shot noise: the variance of radiance falls with the time). A
// value that saturates in all of them is taken from the one that saturates last. Throws StoreError when sizes
// differ.
core::Image merge_exposures(std::span<const Exposure> exposures);

}  // namespace lightstage::db
