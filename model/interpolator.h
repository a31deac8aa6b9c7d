// The one thing this room is about: from a scan, the picture under a light where none stood.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"
#include "core/vec3.h"

namespace lightstage::model {

// Light from far away: from `direction`, with `irradiance` on a surface that faces it, linear RGB in units of pi as
// core::Light::gain (for a part of an environment: radiance x solid angle / pi).
struct DistantLight {
  core::Direction direction;
  core::Vec3 irradiance;
};

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
  // render(query) = sum_i weight_i image_i. Empty for all others.
  virtual std::vector<double> linear_weights(const core::Direction& query) const;

  // For the same methods: what each captured light must shine so that together they make all these lights,
  // sum_q irradiance_q linear_weights(q)_i; many lights then cost one sum of images. The same for every thread count.
  // Empty for all others.
  virtual std::vector<core::Vec3> captured_colours(std::span<const DistantLight> lights) const;

  // For the same methods: the picture when the captured lights shine so, sum_i colour_i image_i, in 3 channels (model/picture_sum.h). A method that
  // holds the images in another form overrides it. Throws BadInput unless there is one finite colour a light.
  virtual core::Image lit_by(std::span<const core::Vec3> colours) const;
};

}  // namespace lightstage::model
