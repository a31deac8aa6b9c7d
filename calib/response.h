// The response of a camera that gives 8-bit display-encoded pictures, from several exposures of one scene.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "calib/linearity.h"
#include "core/image.h"

namespace lightstage::calib {

enum class ResponseMethod { kDebevec, kRobertson };

// From code to light, channel by channel: entry k is the exposure (light times time) that gives code k of 255, rising, 1 at the largest of all.
// Channels are scaled alike where they show 128, which recovering alone cannot know.
struct CameraResponse {
  std::array<std::vector<double>, 3> curve;
  double residual = 0;  // root of the mean squared difference of ln(exposure) between pictures, of codes 20 to 235
};

// By OpenCV: Debevec and Malik 1997 ("Recovering high dynamic range radiance maps from photographs", smoothness 20) or Robertson et al. 2003
// ("Estimation-theoretic approach to dynamic range enhancement using multiple exposures"); made to rise, as real ones do; codes below 12 and above 240 are
// continued by a power. Codes are values times 255,
// as core::read_image gives them with Encoding::kLinear; grey pictures give three equal curves.
// Throws BadInput, naming the picture by its place, for fewer than two different times, times that are not positive, sizes that differ, other
// than 1 or 3 channels, values outside [0, 1], and where fewer than 20 codes are seen at all. About a second.
CameraResponse estimate_response(std::span<const ExposedPicture> pictures,
                                 ResponseMethod method = ResponseMethod::kDebevec);

// Codes (values from 0 to 1, interpolated between codes) to exposure. BadInput for other than 1 or 3 channels.
core::Image exposure_of(core::ImageView codes, const CameraResponse& response);

}  // namespace lightstage::calib
