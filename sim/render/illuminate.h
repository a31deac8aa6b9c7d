// From what a camera sees, and lights, to a picture.
#pragma once

#include "core/image.h"
#include "sim/render/shading.h"
#include "sim/render/surface_buffer.h"

namespace lightstage::sim {

enum class Shadows {
  kExact,        // a shadow ray for every sample and light
  kInterpolated  // Subject::visibility; needs prepare_visibility, and lights of the stage only
};

// Radiance, RGB.
core::Image illuminate(const Subject& subject, const SurfaceBuffer& buffer, const LightSet& lights, Shadows shadows);

// The share of each pixel that sees the subject, one channel.
core::Image coverage(const SurfaceBuffer& buffer);

}  // namespace lightstage::sim
