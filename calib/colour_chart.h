// The camera's colours from a picture of a colour chart of 24 patches (Macbeth, X-Rite ColorChecker Classic).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "core/camera_model.h"
#include "core/image.h"

namespace lightstage::calib {

struct ChartPatch {
  std::string name;  // "dark skin" ... "black", row by row
  core::Pixel centre;
  std::array<double, 3> value{};      // what the camera gives, robust mean of the patch's inner half
  std::array<double, 3> sigma{};      // standard errors of it
  std::array<double, 3> reference{};  // linear Rec. 709 of the patch under D65, a perfect white being 1
  bool used = true;
  std::string reason;  // why not: clipped, dark, uneven
};

struct ChartReading {
  std::array<core::Pixel, 4> corners;  // of the chart's field of patches: beside dark skin, bluish green, black, white
  std::vector<ChartPatch> patches;     // 24
};

// `picture` has three linear channels; `saturation` is the value at which it clips (0: not known). The chart is found by OpenCV's mcc module in any
// perspective, turned by up to 45 degrees either way or upside down; it must be 60 pixels wide or more. `corners` instead says where it is.
// Throws BadInput when no chart is found (what to do included), for other than 3 channels, or values that are not finite.
ChartReading read_chart(core::ImageView picture, double saturation = 0,
                        const std::optional<std::array<core::Pixel, 4>>& corners = std::nullopt);

// From camera colours to linear Rec. 709: matrix x (white_balance * camera). White balance makes the grey patches neutral and keeps green; the matrix's
// rows each sum to 1, so that what is neutral stays as bright as it was.
struct ColourFit {
  std::array<double, 3> white_balance{1, 1, 1};
  std::array<std::array<double, 3>, 3> matrix{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  double exposure = 1;                           // times the result, a perfect white is 1
  std::vector<double> delta_e;                   // CIEDE2000 of every patch, used or not
  std::vector<double> delta_e_balanced;          // with the white balance alone
  double mean_delta_e = 0, largest_delta_e = 0;  // of those used
  double mean_delta_e_balanced = 0;
  std::size_t used = 0;
};

// Least squares of L*a*b* differences over the patches that are used. Throws BadInput for fewer than 12 of them or fewer than two grey ones.
ColourFit fit_colour(const ChartReading& reading);

}  // namespace lightstage::calib
