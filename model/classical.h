// The methods that need no training.
#pragma once

#include <memory>

#include "model/methods.h"

namespace lightstage::model {

// The captured image of the nearest light.
std::unique_ptr<LightInterpolator> make_nearest(const core::OlatScan& scan);

// The k nearest lights blended with alias-free weights.
std::unique_ptr<LightInterpolator> make_linear_blend(const core::OlatScan& scan, int neighbours, double sharpness,
                                                     Domain domain);

// Per-pixel interpolation over the lights' xyz by the thin-plate kernel r^2 log r with a linear polynomial: exact at the captured lights,
// and since the system is the same for all pixels, one signed weight vector over the lights per query (solved once in
// float64). Lights in the same place share their weight; fewer than four lights, or lights in one plane, reduce the polynomial.
// Masselus et al. 2004, "Smooth reconstruction and compact representation of reflectance functions for image-based relighting".
std::unique_ptr<LightInterpolator> make_rbf(const core::OlatScan& scan, Domain domain);

}  // namespace lightstage::model
