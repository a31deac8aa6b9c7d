// What an environment asks of a light stage: how fine its light is, and so whether the captured lights carry it.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "relight/environment.h"
#include "relight/small_sources.h"

namespace lightstage::relight {

// The thresholds that Sun et al. 2020, "Light Stage Super-Resolution", found for a stage of 302 lights, by comparing portraits under many environments:
// blending suffices up to about degree 15, super-resolution pays from about 20. 302 numbers determine no more than degrees 0 to 16 ((L + 1)^2
// harmonics): a stage of fewer lights must meet its limit earlier.
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

// Time: less than that of reading a large map from its file.
EnvironmentAnalysis analyse(const Environment& environment);

// The smallest degree so that it and those below it hold `share` (0 to 1) of all the given energy; 0 where there is none.
int degree_holding(std::span<const double> energy_by_degree, double share);
Verdict verdict_of(int degree_90);

}  // namespace lightstage::relight
