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

// The light (radiance times solid angle, red, green and blue added) that stands out: what of a pixel's radiance is above twice the median within
// 7 degrees of it. A source stands out with what it is brighter than its surround, however bright it is (a median does not follow it), as long as it
// covers less than half of these 7 degrees: sources to 10 degrees across, which is nearly the distance between the lights of a stage of 302 (11.7
// degrees). Larger panels, gradients and the usual texture of a scene do not count; neither does anything in maps whose pixels are 7 degrees wide or more.
// Larger maps are brought to 256x128 for it. Pixels that stand out and touch each other are one source; the brightest is that with the most light, and
// measured in the map as it is. A map without light has no sources. Time: about 0.2 s, and looking at every pixel once or twice.
SmallSources small_sources(const Environment& environment);

}  // namespace lightstage::relight
