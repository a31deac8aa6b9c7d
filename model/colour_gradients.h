// The subject under spherical colour gradients (Meka et al. 2019, "Deep reflectance fields"; Ma et al. 2007, "Rapid acquisition of specular
// and diffuse normal maps from polarized spherical gradient illumination"): two pictures in which every light of the stage shines, each in
// the colour of its place. Here they are summed of the one-light pictures; gradients that a stage captured are not part of a core::OlatScan.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"
#include "core/vec3.h"

namespace lightstage::model {

// What each light shines, red for the x axis of the stage, green for y and blue for z: ((1 + x) / 2, (1 + y) / 2, (1 + z) / 2) in the first
// gradient and ((1 - x) / 2, (1 - y) / 2, (1 - z) / 2) in its inverse, times the light's solid angle over pi. So the two sum to a surrounding of radiance 1, in which a white
// matt surface that sees all of it has radiance 1, whatever the layout of the stage. A light's solid angle is that of its Voronoi cell, but no
// more than twice the median one: a hole in the stage is dark and is not filled by the lights at its rim.
std::array<std::vector<core::Vec3>, 2> colour_gradient_weights(std::span<const core::Direction> lights);

// Both pictures, linear radiance, 3 channels (grey scans are repeated). Reads every image twice; memory as PictureSum. The same for every thread
// count.
std::array<core::Image, 2> colour_gradients(const core::OlatScan& scan);

}  // namespace lightstage::model
