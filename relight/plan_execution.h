// From a plan to a picture.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "model/interpolator.h"
#include "model/picture_sum.h"
#include "relight/captured_knowledge.h"
#include "relight/environment_plan.h"

namespace lightstage::relight {

// Carries out one plan after another for the same environment. Pictures that were synthesised for one serve the next, as far as half a gigabyte holds them.
class PlanExecution {
 public:
  using Deadline = std::optional<std::chrono::steady_clock::time_point>;

  // `captured_colours` as the planner's. All must outlive this.
  PlanExecution(const CapturedKnowledge& captured, const model::LightInterpolator& method,
                std::span<const core::Vec3> captured_colours);

  // Synthesises what the plan asks for, as far as there is time, and changes the plan's lights and variances to what was done and seen. Heeds interruption
  // between pictures; throws what rendering throws.
  core::Image carry_out(Plan& plan, const Deadline& deadline = {});

  // Synthesises one picture, or takes it from those that are kept.
  core::Image picture(const core::Direction& direction);

  // By how much the squares of the differences between synthesised pictures and the interpolation of the captured ones are larger than expected; 1 as long as there is
  // none, and not below 1. Few pictures say little: the expectation counts as much as four of them.
  ByPlace variance_scale() const;

  std::size_t directions_synthesised() const { return rendered_; }    // since the beginning
  std::size_t directions_captured() const { return captured_used_; }  // of the last plan
  double seconds() const { return seconds_; }                         // spent in rendering
  double last_seconds() const { return last_seconds_; }               // of the last picture that was rendered

 private:
  double add(const DistantLight& light, model::PictureSum& sum, std::vector<core::Vec3>& colours);
  void add_remainder(Plan& plan, model::PictureSum& sum, const Deadline& deadline);

  const CapturedKnowledge& captured_;
  const model::LightInterpolator& method_;
  std::vector<core::Vec3> colours_;
  std::map<std::array<double, 3>, core::Image> kept_;
  std::size_t kept_bytes_ = 0, rendered_ = 0, captured_used_ = 0;
  double seconds_ = 0, last_seconds_ = 0;
  ByPlace compared_;             // pictures of the last plan
  ByPlace observed_, expected_;  // sums of squares over them
};

}  // namespace lightstage::relight
