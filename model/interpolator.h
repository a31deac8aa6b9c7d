// The one thing this room is about: from a scan, the picture under a light where none stood.
#pragma once

#include <string_view>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"

namespace lightstage::model {

// Fitted on one scan when it is made. All functions may be called from several threads and give the same result on each.
class LightInterpolator {
 public:
  virtual ~LightInterpolator() = default;

  // As in `--method`.
  virtual std::string_view name() const = 0;
  virtual const core::OlatScan& scan() const = 0;

  // Linear radiance under a unit light from `query`, the size of the scan's images, 3 channels or as many as the scan has.
  virtual core::Image render(const core::Direction& query) const = 0;

  // For methods that are a weighted sum of the captured linear images: one weight a light, so that
  // render(query) = sum_i weight_i image_i; many queries can then be merged into one sum. Empty for all others.
  virtual std::vector<double> linear_weights(const core::Direction& query) const;
};

}  // namespace lightstage::model
