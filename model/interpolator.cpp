#include "model/interpolator.h"

namespace lightstage::model {

std::vector<double> LightInterpolator::linear_weights(const core::Direction&) const {
  return {};
}

}  // namespace lightstage::model
