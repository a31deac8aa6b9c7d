// A clear sky with a sun, for trying things out where no captured environment is at hand.
#pragma once

#include "core/direction.h"
#include "relight/environment.h"

namespace lightstage::relight {

struct SkyOptions {
  core::Direction sun = core::Direction::from_longitude_latitude_degrees(50, 35);  // above the horizon
  int height = 128;                                                                // pixels; the map is twice as wide
  double sun_to_sky = 4;  // irradiance of the sun over that of the sky, on a surface facing each
  double ground_albedo = 0.2;
};

// Luminance of the CIE standard clear sky (ISO 15469:2004, type 12), blue against a warmer sun of 0.53 degrees
// spread over the pixels it touches; below the horizon a grey ground that reflects the light falling on it. The sky's own irradiance on a
// horizontal surface is pi. Throws UsageError for a sun below the horizon or a height below 8.
Environment clear_sky(const SkyOptions& options);

}  // namespace lightstage::relight
