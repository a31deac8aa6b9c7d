// From stored values to radiance per unit light.
#pragma once

#include <array>

#include "core/image.h"

namespace lightstage::db {

// image - dark; an empty `dark` changes nothing. Throws StoreError when the sizes differ.
void subtract_dark(core::Image& image, core::ImageView dark);

// Each channel divided by the light's gain in it; a grey image by the mean of the gains.
void divide_by_gain(core::Image& image, const std::array<double, 3>& gain);

// Each value divided by the flat field's, which has as many channels or one. Empty changes nothing. Throws StoreError when the sizes
// differ.
void divide_by_flat(core::Image& image, core::ImageView flat);

// The colours of each pixel of a picture of three channels by this matrix, a row a channel; others stay as they are.
using ColourMatrix = std::array<std::array<double, 3>, 3>;
void apply_colour(core::Image& image, const ColourMatrix& matrix);

}  // namespace lightstage::db
