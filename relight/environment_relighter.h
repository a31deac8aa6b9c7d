// A subject under environments, with no more synthesis than the error that is accepted asks for.
//
// The exhaustive answer synthesises a picture I(w_p) for every lit pixel p of a map and sums e_p I(w_p), e_p being its irradiance: 32,768 pictures for a
// map of 256 x 128. With L(w), the linear interpolation of the captured pictures by thin-plate splines, and D = I - L it is
//
//     sum_p e_p L(w_p)  +  sum_p e_p D(w_p).
//
// The first sum costs one weighted sum of the captured pictures, exactly and whatever the map. D is 0 where a light stands, and between lights it changes
// its sign over half a spacing: light that is smooth over the spacing of the lights multiplies it by nearly the same everywhere and cancels it.
// So four things need not be computed:
//
//   - what the captured lights say: the whole first sum
//   - the smooth part of the map in the second one (relight/smooth_light.h)
//   - clusters of light for which D is expected to be small, by what the captured pictures tell of each other (relight/light_differences.h)
//   - pictures of lights so near to each other that one stands for all (relight/light_clusters.h)
//
// What is left out by the last three is importance-sampled where that pays: an unbiased estimate of it, which is added as far as it stands out from its
// own noise (James and Stein 1961, "Estimation with quadratic loss"). Energy is kept by construction: L's weights sum to 1, and D of a subject that looks
// the same under all lights is 0; and since a constant map is smooth, its picture is the sum of the captured pictures times their solid angles, whatever the method, but for
// what comes through holes of the stage: there the captured lights say nothing, and what the method says of it counts.
#pragma once

#include <memory>
#include <optional>
#include <variant>

#include "core/image.h"
#include "model/interpolator.h"
#include "relight/captured_knowledge.h"
#include "relight/environment.h"
#include "relight/environment_plan.h"

namespace lightstage::relight {

// What is asked for: an error from the exhaustive answer (ErrorGoal), the best within so many seconds, or the exhaustive answer itself.
struct TimeGoal {
  double seconds = 0;
};
struct Exhaustive {};
using Goal = std::variant<ErrorGoal, TimeGoal, Exhaustive>;

struct EnvironmentReport {
  core::Image image;                            // linear radiance, 3 channels
  std::size_t directions_exhaustive = 0;        // lit pixels of the map
  std::size_t directions_synthesised = 0;       // pictures asked of the method
  std::size_t directions_captured = 0;          // captured pictures that were summed
  double dssim_estimate = 0, rms_estimate = 0;  // expected errors from the exhaustive answer, as ErrorMeasure
  Plan plan;                                    // as carried out; empty where nothing was planned
  double seconds_planning = 0, seconds_synthesising = 0, seconds = 0;
};

// For one scan and method; relights any number of environments. Methods with linear weights are exhaustive without synthesis: the captured pictures carry
// all pixels, in boxes of an eighth of the spacing. Several threads may relight at a time; the result does not depend on the number of threads (but where the goal is
// a time).
class EnvironmentRelighter {
 public:
  // Looks at every image of the scan once. The method must outlive this.
  explicit EnvironmentRelighter(const model::LightInterpolator& method);

  // What relight would do first, before it has seen a synthesised picture: every lit pixel where a plan would take as many; nothing for methods with
  // linear weights. Throws as relight.
  Plan plan(const Environment& environment, const ErrorGoal& goal) const;

  // Throws UsageError for an error or time that is not above 0, and what rendering throws. Heeds interruption between pictures.
  EnvironmentReport relight(const Environment& environment, const Goal& goal) const;

 private:
  EnvironmentReport within(const Environment& environment, const ErrorGoal& goal) const;
  EnvironmentReport within(const Environment& environment, const TimeGoal& goal) const;

  const model::LightInterpolator& method_;
  std::unique_ptr<const CapturedKnowledge> captured_;  // null for methods with linear weights
};

}  // namespace lightstage::relight
