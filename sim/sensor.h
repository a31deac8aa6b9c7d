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

// One exposure. `radiance` has 1 or 3 channels, `responsivity` is that of StageCamera. What happens, in turn:
//
// - Vignetting: signal = radiance * responsivity * seconds * (1 - vignetting * (r / r_corner)^2), in full scales;
//   r is the distance from the image centre.
// - Bayer mosaic, if asked for (3 channels only): one colour a pixel, rows RGRG... and GBGB...
// - Shot noise: Poisson with mean signal * full_well_electrons. Read noise: normal, read_noise_electrons.
// - Quantisation to `bits`, clipping at full scale. The black level lies at 1/64 of the codes, so that noise about
//   black is not rectified.
// - The driver: black level off, back to radiance = signal / (responsivity * seconds), bilinear demosaicing (the mean
//   of the nearest pixels of each colour).
//
// Vignetting is not undone. Values may lie slightly below 0; none is above saturation_radiance. With spec.noise off,
// vignetting, mosaic and clipping remain. The result depends on the seed and not on the thread count.
// Throws BadInput for other channel counts and for values out of range.
core::Image sense(core::ImageView radiance, const SensorSpec& spec, double responsivity, core::Nanoseconds exposure,
                  std::uint64_t noise_seed);

}  // namespace lightstage::sim
