#include "model/classical.h"

#include <string>
#include <utility>

#include "core/error.h"
#include "core/sphere.h"
#include "model/alias_free_weights.h"
#include "model/classical/barycentric_weights.h"
#include "model/classical/bspline_weights.h"
#include "model/classical/radial_basis.h"
#include "model/classical/weighted_images.h"

namespace lightstage::model {

namespace {

// Methods whose weights for many lights at once come cheaper than one by one.
template <class SummableWeights>
class SummableImages : public WeightedImages {
 public:
  SummableImages(const std::string& name, const core::OlatScan& scan, Domain domain,
                 const std::shared_ptr<const SummableWeights>& weights)
      : WeightedImages(name, scan, domain, [weights](const core::Direction& query) { return (*weights)(query); }),
        domain_(domain),
        weights_(weights) {}
  std::vector<core::Vec3> captured_colours(std::span<const DistantLight> lights) const override {
    return domain_ == Domain::kLinear ? weights_->sum(lights) : std::vector<core::Vec3>();
  }

 private:
  Domain domain_;
  std::shared_ptr<const SummableWeights> weights_;
};

// Those of them that need every image for every query.
template <class SummableWeights>
class GlobalWeights : public SummableImages<SummableWeights> {
 public:
  GlobalWeights(const std::string& name, const core::OlatScan& scan, Domain domain,
                const std::shared_ptr<const SummableWeights>& weights)
      : SummableImages<SummableWeights>(name, scan, domain, weights) {
    this->prepare();
  }
};

}  // namespace

std::unique_ptr<LightInterpolator> make_nearest(const core::OlatScan& scan) {
  auto weights = [lights = scan.directions()](const core::Direction& query) {
    std::vector<double> result(lights.size(), 0.0);
    result[core::nearest_indices(lights, query, 1).front()] = 1;
    return result;
  };
  return std::make_unique<WeightedImages>("nearest", scan, Domain::kLinear, std::move(weights));
}

std::unique_ptr<LightInterpolator> make_linear_blend(const core::OlatScan& scan, int neighbours, double sharpness,
                                                     Domain domain) {
  if (neighbours < 1) throw core::UsageError("linear blends at least 1 neighbour, not " + std::to_string(neighbours));
  auto weights = [lights = scan.directions(), neighbours, sharpness](const core::Direction& query) {
    const std::vector<std::size_t> active = core::nearest_indices(lights, query, std::size_t(neighbours));
    std::vector<core::Direction> active_lights;
    for (const std::size_t i : active) active_lights.push_back(lights[i]);
    const std::vector<double> active_weights = alias_free_weights(query, active_lights, sharpness);
    std::vector<double> result(lights.size(), 0.0);
    for (std::size_t i = 0; i < active.size(); ++i) result[active[i]] = active_weights[i];
    return result;
  };
  return std::make_unique<WeightedImages>("linear", scan, domain, std::move(weights));
}

std::unique_ptr<LightInterpolator> make_barycentric(const core::OlatScan& scan, Domain domain) {
  return std::make_unique<SummableImages<BarycentricWeights>>(
      "barycentric", scan, domain, std::make_shared<const BarycentricWeights>(scan.directions()));
}

std::unique_ptr<LightInterpolator> make_rbf(const core::OlatScan& scan, Domain domain, const RadialBasis& basis) {
  return std::make_unique<GlobalWeights<RadialBasisWeights>>(
      "rbf", scan, domain, std::make_shared<const RadialBasisWeights>(scan.directions(), basis));
}

std::unique_ptr<LightInterpolator> make_bspline(const core::OlatScan& scan, Domain domain) {
  return std::make_unique<GlobalWeights<BSplineWeights>>("bspline", scan, domain,
                                                         std::make_shared<const BSplineWeights>(scan.directions()));
}

}  // namespace lightstage::model
