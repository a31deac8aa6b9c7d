// Which pixels of a grey ball say how it is lit.
#pragma once

namespace lightstage::calib {

constexpr double kRimPx = 2;           // pixels this near the outline also see the background
constexpr double kLeastCosine = 0.15;  // below it the lamp's size and the surface's gloss matter
constexpr int kLeastPixels = 64;

}  // namespace lightstage::calib
