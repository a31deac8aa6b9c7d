#include "relight/captured_knowledge.h"

#include "model/classical.h"

namespace lightstage::relight {

CapturedKnowledge::CapturedKnowledge(const core::OlatScan& scan)
    : differences(scan),
      interpolation(interpolation_of_captured(scan)),
      barycentric(model::make_barycentric(scan, model::Domain::kLinear)) {}

std::unique_ptr<const model::LightInterpolator> interpolation_of_captured(const core::OlatScan& scan) {
  constexpr std::size_t kMostLightsOfSplines = 8000;  // of make_rbf
  if (scan.light_count() > kMostLightsOfSplines) return model::make_barycentric(scan, model::Domain::kLinear);
  return model::make_rbf(scan, model::Domain::kLinear);
}

}  // namespace lightstage::relight
