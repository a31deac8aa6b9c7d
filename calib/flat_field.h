// Flat field and vignetting from pictures of an evenly lit white card or diffuser.
#pragma once

#include <array>
#include <functional>
#include <span>
#include <vector>

#include "core/image.h"

namespace lightstage::calib {

// One picture of the card, linear, free of ambient light.
struct FlatPicture {
  core::ImageView picture;
  double saturation = 0;  // as in CameraFrame: cells with clipped pixels are left out; 0: not known
  // How strongly the card is lit where the pixel (x, y) sees it, to any factor, where that is known; empty: evenly, but for a gradient.
  std::function<double(double x, double y)> illumination = {};
};

struct FlatOptions {
  int degree = 3;  // even powers of the radius: r^2 to r^(2 degree); 1 to 5
  bool smooth_residual =
      false;  // also what all pictures have in common beyond it, smoothed over a tenth of the picture
};

struct FlatField {
  core::Image flat;            // as many channels as the pictures, 1 in the middle
  std::vector<double> corner;  // its value in the corners, a channel
  double sigma = 0;            // largest relative standard error over the picture
  double condition = 0;        // of the fit's design matrix
  double residual = 0;         // robust relative standard deviation of cells about the fit
  double rejected = 0;         // share of cells left out: clipped, dark, dust
  std::vector<std::array<double, 2>>
      gradients;  // per picture: relative change of the illumination from middle to right and lower edge
  std::vector<std::array<double, 2>>
      profile;  // r over the corner's, and the flat there, mean of the channels, for plots
};

// The logarithm of the mean of each of about 48 x 48 cells is fitted by
//   log v = log illumination + c_j + g_j . (x, y) + sum_k a_k L_k(r^2 / r_corner^2)
// with a plane for each picture j and even radial terms that all pictures share; L_k are Legendre polynomials on [0, 1], which keeps the fit well
// conditioned. r is measured from the picture's middle. A gradient of the light therefore does not enter the flat, and neither does what a lens that is
// off the middle adds to it; curvature of the light does, unless `illumination` tells of it or several pictures, between which light and card
// were moved, average it out. Dust and other outliers are rejected (Tukey's biweight, Beaton and Tukey 1974). Where pictures disagree by more than their noise, standard errors are
// raised until they do not; a curvature that all pictures share is not in them.
// Throws BadInput, naming the picture by its place, for none, sizes that differ, fewer than 32 pixels a side, values that are not finite,
// and where less than half of the cells are lit and not clipped. O(pixels).
FlatField fit_flat_field(std::span<const FlatPicture> pictures, const FlatOptions& options = {});

}  // namespace lightstage::calib
