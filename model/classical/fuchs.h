// Super-resolution by layers that move.
#pragma once

#include <memory>

#include "model/interpolator.h"

namespace lightstage::model {

// The layers of the query (model/classical/layers_between.h) make a model of its picture, and of the captured ones:
//   M = V e(D + S) + (1 - V) e(S),   e(v) = max(v / exposure, 0)^(1/2.2),
// display-encoded, in which blending errs less. What the model leaves of the captured pictures is blended, at every pixel from the lights that see it as it
// is to be, lit or in shadow:
//   e(picture) = M(q) + sum_i W'_i (e(I_i) - M_i),   W'_i ~ W_i (V(q) V_i + (1 - V(q)) (1 - V_i) + 0.02) clamp(|phi_i| - 0.5, 0.02, 1).
// The last factor leaves out what is half in shadow at an edge of light i, or every edge would leave a line where it was. Where the layers say nothing it is
// blending.
//
// After Fuchs et al. 2007, "Superresolution reflectance fields: synthesizing images for intermediate light directions": layers, highlights moved by optical
// flow, and what went wrong corrected from the captured pictures. Theirs blends the rest; a Lambertian surface carries ours, and shadows move by signed
// distance instead of flow. Making it costs estimate_normals, a query 0.2 to 0.5 s a core at 256 x 256 pixels.
std::unique_ptr<LightInterpolator> make_fuchs(const core::OlatScan& scan);

}  // namespace lightstage::model
