#include "cli/relight/relit.h"

namespace lightstage::cli {

relight::RelightReport relit(const model::LightInterpolator& interpolator, const relight::Environment& environment,
                             const RelitOptions& options) {
  return relight::relight_environment(interpolator, environment, options.virtual_lights);
}

}  // namespace lightstage::cli
