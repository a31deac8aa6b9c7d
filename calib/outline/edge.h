// Where the rim of a ball crosses a line of samples, to a fraction of a pixel.
#pragma once

#include <optional>
#include <span>
#include <vector>

namespace lightstage::calib {

// Fits brightness along a line that leaves the ball through its rim. Just inside the rim, at a depth d from
// it, the surface normal's part towards the camera is sqrt(2 d / radius), and irradiance is smooth in the
// normal, so that brightness is
//   background + step + slope sqrt(2 d / radius)   inside,   background   outside,
// both blurred by lens and pixel (a Gaussian). The plain maximum of the gradient would lie too far inside
// wherever the ball gets darker towards its rim; this model has the rim itself as a parameter.
class RimModel {
 public:
  static constexpr double kSampleStepPx = 0.5;

  // Samples lie at (i - half_width / kSampleStepPx) kSampleStepPx from the expected rim, i from 0 to
  // sample_count() - 1, inside first.
  RimModel(double radius_px, double blur_px, double half_width_px, double search_px);
  int sample_count() const { return sample_count_; }

  struct Edge {
    double offset_px = 0;  // from the expected rim, outwards
    double step = 0;       // brightness just inside over that outside
    double misfit = 0;     // root mean square of what the model leaves
  };
  // The rim within search_px of where it is expected; nothing when the best fit lies at the end of the
  // search.
  std::optional<Edge> fit(std::span<const double> samples) const;

 private:
  // An orthonormal basis of {1, step, slope} for one candidate offset, so that a fit is three dot products.
  struct Candidate {
    double offset_px;
    std::vector<double> basis[3];
    double step_row[3];  // step = sum of step_row[k] times the k-th coefficient
  };
  int sample_count_;
  std::vector<Candidate> candidates_;
};

}  // namespace lightstage::calib
