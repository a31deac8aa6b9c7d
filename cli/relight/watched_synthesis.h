// Synthesis that is seen from outside: a picture under a soft light or an environment is a sum of hundreds, and takes minutes.
#pragma once

#include <functional>

#include "model/interpolator.h"

namespace lightstage::cli {

// The same method, which says when it has synthesised a picture.
class WatchedSynthesis final : public model::LightInterpolator {
 public:
  // `method` must outlive this. `synthesised` is called after each picture, from the thread that asked for it.
  WatchedSynthesis(const model::LightInterpolator& method, std::function<void()> synthesised);

  std::string_view name() const override;
  const core::OlatScan& scan() const override;
  core::Image render(const core::Direction& query) const override;
  std::vector<double> linear_weights(const core::Direction& query) const override;
  std::vector<core::Vec3> captured_colours(std::span<const model::DistantLight> lights) const override;
  core::Image lit_by(std::span<const core::Vec3> colours) const override;

 private:
  const model::LightInterpolator& method_;
  std::function<void()> synthesised_;
};

}  // namespace lightstage::cli
