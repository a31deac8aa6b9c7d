// Blending weights that change continuously with the query, whatever set of lights is active (Sun et al. 2020, "Light Stage
// Super-Resolution", section 4.2).
#pragma once

#include <span>
#include <vector>

#include "core/direction.h"

namespace lightstage::model {

// w_i = max(0, exp(s (q.l_i - 1)) - min_j exp(s (q.l_j - 1))),  W_i = w_i / sum_j w_j: the farthest light of the active set weighs
// nothing, so a light enters and leaves the set with weight zero. q.l - 1 is computed as -|q-l|^2/2 and the differences of
// exponentials by expm1, relative to the nearest light, so every s in [0, 1e6] and every geometry gives finite weights that sum
// to 1. Where all lights are equally far (or there is one), which is 0/0 as written, the weights are uniform, and fade to
// uniform where the q.l_i agree to about 1e-12; s = 0 gives the limit s -> 0, weights proportional to
// |q-l_far|^2 - |q-l_i|^2. Throws BadInput for no lights or a negative or non-finite s.
std::vector<double> alias_free_weights(const core::Direction& query, std::span<const core::Direction> lights, double s);

// The same weights and their derivatives by ln s, finite wherever the weights are: what training s needs.
struct SlopedWeights {
  std::vector<double> weights;  // W_i
  std::vector<double> slopes;   // d W_i / d ln s = s dW_i/ds; they sum to 0
};
SlopedWeights sloped_alias_free_weights(const core::Direction& query, std::span<const core::Direction> lights,
                                        double s);

// The s that suits a light spacing (radians): about 2 / spacing^2, measured on real and simulated stages. Throws
// BadInput for a spacing that is not a finite number > 0.
double default_sharpness(double spacing_radians);

}  // namespace lightstage::model
