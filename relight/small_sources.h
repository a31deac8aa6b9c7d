// Small bright sources in an environment: suns, lamps, windows far away. They cast the shadows whose edges depend on directions between lights.
#pragma once

#include <optional>

#include "core/direction.h"
#include "relight/environment.h"

namespace lightstage::relight {

struct LightSource {
  core::Direction direction;  // the mean of its light's
  double diameter_degrees =
      0;             // of the even disc with as much light and as much squared radiance; never less than a pixel's
  double share = 0;  // of the environment's light
};

struct SmallSources {
  double share = 0;  // of the environment's light, 0 to 1
  std::optional<LightSource> brightest;
};

// The light (radiance times solid angle, red, green and blue added) that stands out: what of a pixel's radiance is above twice its surround's, which is the
// radiance that 60 % of the area within 8 degrees does not exceed. A source counts, however bright, as long as it covers less than 40 % of that area:
// to 10 degrees across, which is nearly the distance between the lights of a stage of 302 (11.7 degrees). Wider panels do not count (half of the
// area would do, but for their rims), nor do gradients and the usual texture of a scene, nor anything in maps whose pixels are 8 degrees wide or more.
// Larger maps are brought to 256x128 for it. Pixels that stand out and touch each other are one source; the brightest is that with the most light, and
// measured in the map as it is. A map without light has no sources. Time: that of looking at every pixel a few times.
SmallSources small_sources(const Environment& environment);

}  // namespace lightstage::relight
