// The methods that need no training. All are a weighted sum of the captured images, one weight a light and query. Methods may be made and
// used while other threads use the same scan. What loading an image throws comes out of the function that needed it.
#pragma once

#include <memory>

#include "model/methods.h"

namespace lightstage::model {

// The captured image of the nearest light; of equally near ones that of the lowest index.
std::unique_ptr<LightInterpolator> make_nearest(const core::OlatScan& scan);

// The k nearest lights (all where there are fewer) blended with alias-free weights of the given s (model/alias_free_weights.h). Throws
// UsageError for less than one neighbour. kDisplay reads every image once for the scan's exposure.
std::unique_ptr<LightInterpolator> make_linear_blend(const core::OlatScan& scan, int neighbours, double sharpness,
                                                     Domain domain);

// The three lights around the query, with barycentric weights over the spherical Delaunay triangulation; holes of the stage are filled as by a soap film
// (model/classical/barycentric_weights.h). Never negative, sums to 1, exact at the captured lights, continuous, no knob to fit; creases at the
// triangles' edges. A query costs three images.
std::unique_ptr<LightInterpolator> make_barycentric(const core::OlatScan& scan, Domain domain);

// Per-pixel interpolation over the lights' xyz by a radial kernel, thin-plate or linear, with a linear polynomial: exact at the captured lights unless
// smoothed, and since the system is the same for all pixels, one signed weight vector over the lights per query, which sums to 1 (the system is
// inverted once, in float64). Lights in the same place share their weight; fewer than four lights, or lights in one plane, reduce the
// polynomial. A query costs all n images: about 0.4 ns a value and image where memory serves 10 GB/s. kDisplay makes encoded copies of all
// images first and keeps them where they take at most 4 GB. Throws UsageError for more than 8000 lights or a smoothing below 0.
// Masselus et al. 2004, "Smooth reconstruction and compact representation of reflectance functions for image-based relighting".
std::unique_ptr<LightInterpolator> make_rbf(const core::OlatScan& scan, Domain domain, const RadialBasis& basis = {});

// Per-pixel interpolation by multilevel B-splines (model/classical/bspline_weights.h), exact at the captured lights and with two continuous derivatives: one signed
// weight vector per query, which sums to 1. Costs and display-encoded copies as of rbf. Lee et al. 1997; Masselus et al. 2004, as above.
std::unique_ptr<LightInterpolator> make_bspline(const core::OlatScan& scan, Domain domain);

}  // namespace lightstage::model
