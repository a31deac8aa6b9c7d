// Relighting a matte surface.
#pragma once

#include <memory>

#include "model/interpolator.h"

namespace lightstage::model {

// D V + S with the layers of the query alone (model/classical/layers_between.h): the Lambertian surface of estimate_normals with its attached shadows, and
// cast shadows and highlights as fuchs moves them. What is not in these layers (light scattered in the skin or between surfaces, in shadow) is missing.
// Costs as fuchs.
std::unique_ptr<LightInterpolator> make_photometric_stereo(const core::OlatScan& scan);

}  // namespace lightstage::model
