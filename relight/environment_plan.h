// What must be synthesised for one environment (the sums and what they leave out are in relight/environment_relighter.h).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/vec3.h"
#include "relight/captured_knowledge.h"
#include "relight/environment.h"
#include "relight/light_clusters.h"

namespace lightstage::relight {

enum class ErrorMeasure {
  kDssim,        // of display-encoded pictures, exposed so that their 99.5th percentile is 1 (model/metrics.h)
  kRelativeRms,  // root mean square of the linear difference over that of the picture, inside the mask
};

struct ErrorGoal {
  double error = 0.002;
  ErrorMeasure measure = ErrorMeasure::kDssim;
};

struct Plan {
  std::vector<DistantLight> synthesised;  // those that save most come first
  std::vector<ByPlace> saved;             // variance, by synthesised light
  std::vector<DistantLight> remainder;    // synthesised too: drawn at random, each with the light that it stands for

  // Squares of the root mean square error that is expected to stay, in linear radiance: of light that is left out or represented, and of the smooth part.
  ByPlace variance_left;
  double smooth_variance = 0;            // with the samples of the remainder, where there are any
  double unsampled_smooth_variance = 0;  // without them
  double picture_rms = 0;  // of the picture without synthesis; 0 where it is black, and nothing needs to be done
  // DSSIM over the square of the relative error, for small errors of either kind.
  ByPlace dssim_per_square;
  double smooth_dssim_per_square = 0;

  std::size_t pictures() const { return synthesised.size() + remainder.size(); }
  double expected_error(ErrorMeasure measure) const;
};

class EnvironmentPlanner {
 public:
  // Costs four weighted sums of the captured pictures and about a microsecond a patch and captured light; patches are as wide as an eighth of the lights'
  // spacing, so some 30,000 on a stage of 300 lights, however large the map is.
  EnvironmentPlanner(const CapturedKnowledge& captured, const core::OlatScan& scan, const Environment& environment);

  // The fewest pictures with which the error is expected to be kept, if variances are `scale` times as large as the captured pictures let expect.
  Plan within(const ErrorGoal& goal, const ByPlace& scale = kAlike) const;
  // The best with at most so many pictures.
  Plan at_most(std::size_t pictures) const;

  // What the captured lights must shine to carry the whole map by interpolation.
  const std::vector<core::Vec3>& captured_colours() const { return colours_; }

 private:
  std::vector<DoubtfulLight> doubtful_light() const;
  double expected_smooth_variance() const;
  core::Image difference_between_lights() const;
  core::Image difference_in_holes() const;
  core::Image difference_of_smooth_light() const;
  core::Vec3 remainder(const Cut& cut, std::size_t patch) const;
  std::vector<double> importance(const Cut& cut) const;
  double noise_of_one_sample(const Cut& cut) const;
  void sample(Plan& plan, const Cut& cut, std::size_t count) const;

  const CapturedKnowledge& captured_;
  const core::OlatScan& scan_;
  std::vector<Patch> patches_;
  std::vector<std::size_t> order_;                       // of the patches, neighbours together
  std::vector<LightDifferences::NearestLight> nearest_;  // by patch, as all that follow
  std::vector<core::Vec3> smooth_;
  std::vector<DoubtfulLight> doubtful_;
  LightClusters clusters_;
  std::vector<core::Vec3> colours_;
  Plan nothing_;  // without synthesis
};

// Root mean square over the masked pixels and all channels; an empty mask means everywhere.
double masked_rms(const core::Image& image, const core::Image& mask);

}  // namespace lightstage::relight
