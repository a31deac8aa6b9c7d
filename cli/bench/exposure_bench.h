// How exact merged exposures are on the simulated 12-bit sensor.
#pragma once

#include <vector>

namespace lightstage::cli {

// A bracket, and how the merge weighs its exposures (core/exposure_merge.h).
struct BracketKnobs {
  int exposures = 5;
  double stops_between = 2;
  double read_noise_share = 0.001;  // 0: by time alone, as photons are counted; large: by the square of time
};

struct BracketRow {
  BracketKnobs knobs;
  double seconds = 0;        // of exposure for one light, in units of the shortest exposure's
  double merge_seconds = 0;  // for a million values
  double noise_percent = 0;  // of a pixel: relative standard deviation, root of the mean square over the stops
  double largest_deviation_percent = 0;  // of the mean from proportionality, over the stops
};

// Radiance over 14 stops, in half stops from 0.78 of what clips the shortest exposure, seen through the simulated sensor (sim/sensor.h: noise,
// 12 bits, no vignetting) and merged. `pixels` a level: what is left of noise in the means is about noise_percent / sqrt(pixels).
BracketRow measure_bracket(const BracketKnobs& knobs, int pixels = 40000);

// Of the default bracket: the largest deviation from proportionality over 14 stops, percent.
double hdr_linearity_percent();

// Number of exposures, stops between them, and weights.
std::vector<BracketRow> bracket_frontier();

}  // namespace lightstage::cli
