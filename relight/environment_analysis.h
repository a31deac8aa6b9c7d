// What an environment asks of a light stage: how fine its light is, and so whether the captured lights carry it.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "relight/environment.h"
#include "relight/small_sources.h"

namespace lightstage::relight {

// The thresholds of Sun et al. 2020, "Light Stage Super-Resolution", from portraits under a stage of 302 lights: between blending and
// super-resolution no difference is seen in environments to about degree 15, and a growing one from about 20. On a stage with fewer lights both
// come earlier (the finest degree that n lights can carry at all goes with the root of n).
enum class Verdict {
  kLinear,          // degree_90 <= 15: blending the captured lights suffices
  kEither,          // between
  kSuperResolution  // degree_90 >= 20: synthesised lights pay
};
std::string_view verdict_name(Verdict verdict);  // linear, either, super_resolution

struct EnvironmentAnalysis {
  // Degrees 0 to 50 (Harmonics::energy_by_degree), radiance^2 steradians.
  std::vector<double> energy_by_degree;
  // The smallest degree so that it and those below it hold 90 % of the energy of degrees 0 to 50. Degree 0 counts: it is what is asked how much of the
  // map its first degrees give back, an even sky is given back by degree 0 alone, and without it the ripple of a nearly even sky would be judged as
  // strictly as a sun. Energy is of squared radiance: what is small and bright counts for more than its light. A point has degree 48, an even sky and
  // a map without light 0.
  int degree_90 = 0;
  // Of the energy of all degrees (the integral of the squared map), what is above degree 50: nearly all of it for a sun.
  double share_above_50 = 0;
  Verdict verdict = Verdict::kLinear;
  SmallSources small_sources;
};

// Time: about two seconds on a core for 8192x4096 pixels, less than their reading.
EnvironmentAnalysis analyse(const Environment& environment);

// The smallest degree so that it and those below it hold `share` (0 to 1) of all the given energy; 0 where there is none.
int degree_holding(std::span<const double> energy_by_degree, double share);
Verdict verdict_of(int degree_90);

}  // namespace lightstage::relight
