// The simulated sensor and its driver: from the radiance that a lens delivers to the linear radiance that a
// camera reports.
#pragma once

#include <cstdint>

#include "core/clock.h"
#include "core/image.h"
#include "sim/simulation.h"

namespace lightstage::sim {

// The radiance at which the sensor clips: 1 / (responsivity * seconds).
double saturation_radiance(double responsivity, core::Nanoseconds exposure);

// One exposure. `radiance` has 1 or 3 channels, `responsivity` is StageCamera's. In turn:
//   vignetting    signal = radiance * responsivity * seconds * (1 - vignetting * (r / r_corner)^2), r from the image
//                 centre, in full scales
//   Bayer         (if asked; 3 channels) one colour a pixel, rows RGRG... and GBGB...
//   shot noise    Poisson with mean signal * full_well_electrons
//   read noise    normal, read_noise_electrons
//   quantisation  to `bits`, with a black level of 1/64 of the codes so that noise about black is not rectified;
//                 clips at full scale
//   demosaic      (if Bayer) bilinear: the mean of the nearest pixels of each colour
// and back: radiance = signal / (responsivity * seconds), black level taken off. Vignetting is not undone; values may
// be slightly below 0, none is above saturation_radiance. With spec.noise off, vignetting, Bayer and clipping
// remain. The same for the same `noise_seed` on any number of threads. Throws BadInput for other channel counts, bits
// outside 1 to 24, and an exposure, responsivity or full well that is not positive.
core::Image sense(core::ImageView radiance, const SensorSpec& spec, double responsivity, core::Nanoseconds exposure,
                  std::uint64_t noise_seed);

}  // namespace lightstage::sim
