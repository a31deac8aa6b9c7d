// What the methods without training share: a picture is a weighted sum of the captured ones, and the method is its
// weights.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "model/interpolator.h"
#include "model/methods.h"

namespace lightstage::model {

class WeightedImages : public LightInterpolator {
 public:
  // One finite weight a light of the scan; called from several threads.
  using Weights = std::function<std::vector<double>(const core::Direction& query)>;

  // In Domain::kDisplay the sum is of display-encoded values (relative to the scan's exposure, negative light
  // counts as none), which is then decoded (core::OlatScan::display_encoded).
  WeightedImages(std::string name, const core::OlatScan& scan, Domain domain, Weights weights);

  std::string_view name() const override { return name_; }
  const core::OlatScan& scan() const override { return scan_; }
  core::Image render(const core::Direction& query) const override;
  std::vector<double> linear_weights(const core::Direction& query) const override;

 protected:
  // Makes the encoded copies now, where all of them can be kept: for methods that need every image for every query.
  void prepare() const;

 private:
  std::string name_;
  core::OlatScan scan_;
  core::OlatScan summed_;  // scan_, or its display-encoded copy
  Domain domain_;
  Weights weights_;
};

}  // namespace lightstage::model
