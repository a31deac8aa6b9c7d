// The picture under an environment.
#pragma once

#include <cstddef>

#include "model/interpolator.h"
#include "relight/environment.h"
#include "relight/relight.h"

namespace lightstage::cli {

struct RelitOptions {
  std::size_t virtual_lights = 512;  // directions that stand for it, for methods that are not linear
};

relight::RelightReport relit(const model::LightInterpolator& interpolator, const relight::Environment& environment,
                             const RelitOptions& options);

}  // namespace lightstage::cli
