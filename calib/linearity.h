// Whether a camera's values are proportional to light, and what its noise tells of it.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/image.h"

namespace lightstage::calib {

// One exposure of a still scene under steady light, values as the camera gives them.
struct ExposedPicture {
  core::ImageView picture;
  double seconds = 0;
};

struct LinearityPoint {
  double signal =
      0;  // above the black level, over that at which the camera clips (over the largest one where it does not)
  double deviation = 0;  // of the value from proportionality there, relative
};

struct LinearityReport {
  bool linear = false;                 // deviates by less than kLinearTo from kLinearFrom to 0.95 of the range
  std::string verdict;                 // one line
  double black_level = 0;              // the value of no light
  std::optional<double> clips_at;      // the value, where pictures show one
  double largest_deviation = 0;        // relative, of the points
  double largest_at = 0;               // its signal
  std::vector<LinearityPoint> points;  // by rising signal
  std::vector<LinearityPoint>
      exposures;  // a picture, in their order: mean signal of its usable cells, and their mean deviation. One that stands out
                  // alone has another exposure time than was said
  // By photon transfer, where there are two pictures of one exposure at three exposures or more.
  std::optional<double> electrons_per_unit;
  std::optional<double> read_noise_electrons;
  std::optional<double> full_well_electrons;  // at which the camera clips
};

inline constexpr double kLinearTo = 0.01;
inline constexpr double kLinearFrom = 0.05;

// Cells of 16 x 16 pixels are fitted by value = black level + brightness of the cell x seconds over all exposures in which none of their pixels clips,
// least squares of relative deviations as in EMVA standard 1288 (release 4.0, section 6.7); deviations are averaged by signal. Clipping shows as many
// values at one largest value. Photon transfer (Janesick 2007, "Photon Transfer", chapter 5): half the variance of the difference of two pictures of
// one exposure is signal / electrons_per_unit + read noise^2. Pictures that were demosaiced, scaled or compressed have less noise than their
// photons, and seem to have more electrons.
// Throws BadInput, naming the picture by its place, for fewer than three different exposure times, times that are not positive, sizes that differ, values
// that are not finite, and where no cell is bright enough in two exposures at least. O(pixels).
LinearityReport check_linearity(std::span<const ExposedPicture> pictures);

}  // namespace lightstage::calib
