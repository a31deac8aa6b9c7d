// The bright blob in a dark picture, to the pixel: where the search for a ball's outline starts.
#pragma once

#include <vector>

#include "core/camera_model.h"
#include "core/image.h"

namespace lightstage::calib {

struct Blob {
  std::vector<core::Pixel> contour;  // its outermost pixels, without those at the picture's border
  double level = 0;                  // median luminance inside
  double noise = 0;                  // standard deviation of a pixel
};

// The largest connected part that stands out from the background, however bright single highlights on it are.
// `luminance` has one channel. Throws BadInput when there is none, or it fills the picture.
Blob find_blob(core::ImageView luminance);

}  // namespace lightstage::calib
