// What is known of a scan before anything is synthesised; the same for all environments.
#pragma once

#include <memory>

#include "core/olat_scan.h"
#include "model/interpolator.h"
#include "relight/light_differences.h"

namespace lightstage::relight {

struct CapturedKnowledge {
  // Looks at every image once. O(lights^3) for the interpolations.
  explicit CapturedKnowledge(const core::OlatScan& scan);

  LightDifferences differences;
  // L of relight/environment_relighter.h, in linear light: thin-plate splines, which of all methods with linear weights differ least from the networks;
  // barycentric for stages of more lights than those are made for.
  std::unique_ptr<const model::LightInterpolator> interpolation;
  std::unique_ptr<const model::LightInterpolator> barycentric;  // in linear light: never negative
};

std::unique_ptr<const model::LightInterpolator> interpolation_of_captured(const core::OlatScan& scan);

}  // namespace lightstage::relight
