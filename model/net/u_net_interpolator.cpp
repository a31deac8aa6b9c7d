#include "model/net/u_net_interpolator.h"

#include <torch/torch.h>

#include <utility>
#include <vector>

#include "core/sphere.h"
#include "model/alias_free_weights.h"
#include "model/classical.h"
#include "model/colour_gradients.h"
#include "model/net/meka_network.h"
#include "model/net/pixels.h"
#include "model/net/xu_network.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

class UNetInterpolator : public LightInterpolator {
 public:
  UNetInterpolator(const core::OlatScan& scan, std::unique_ptr<const Network> network);

  std::string_view name() const override { return architecture_name(network_->config().architecture); }
  const core::OlatScan& scan() const override { return scan_; }
  core::Image render(const core::Direction& query) const override;

 private:
  core::OlatScan scan_, encoded_;
  std::unique_ptr<const Network> network_;
  double spacing_;
  std::unique_ptr<LightInterpolator> outside_;
  Window mask_window_, window_;  // the second grown to the sizes that the network takes
  // For networks that look at the same lights whatever the query: those, and what they see.
  std::vector<std::size_t> fixed_lights_;
  Tensor fixed_pictures_;
};

UNetInterpolator::UNetInterpolator(const core::OlatScan& scan, std::unique_ptr<const Network> network)
    : scan_(scan),
      encoded_(scan.display_encoded()),
      network_(std::move(network)),
      spacing_(core::median_spacing_radians(scan.directions())),
      outside_(make_linear_blend(scan, 8, default_sharpness(spacing_), Domain::kDisplay)),
      mask_window_(bounding_window(scan.mask())),
      window_(rounded_up(mask_window_, network_->size_multiple())) {
  prepare_torch();
  if (const auto* xu = dynamic_cast<const XuNetwork*>(network_.get())) {
    fixed_lights_ = xu->select(scan.directions());
    fixed_pictures_ = pictures_in(encoded_, fixed_lights_, window_);
  } else if (dynamic_cast<const MekaNetwork*>(network_.get())) {
    std::vector<Tensor> gradients;
    for (const core::Image& gradient : colour_gradients(scan)) {
      gradients.push_back(cut(to_display(gradient, scan.exposure()), window_));
    }
    fixed_pictures_ = torch::stack(gradients);
  }
}

core::Image UNetInterpolator::render(const core::Direction& query) const {
  const c10::InferenceMode inference;
  const std::vector<core::Direction>& lights = scan_.directions();
  const bool fixed = fixed_pictures_.defined();
  const ActiveSet set = network_->active_set(
      query, lights,
      fixed ? fixed_lights_ : core::nearest_indices(lights, query, std::size_t(network_->config().neighbours)),
      spacing_);
  const Tensor inside =
      network_->predict(fixed ? fixed_pictures_ : pictures_in(encoded_, set.lights, window_), {}, set);

  const double exposure = scan_.exposure();
  Tensor picture = to_display(outside_->render(query), exposure);
  cut(picture, mask_window_).copy_(cut(inside[0], {0, 0, mask_window_.height, mask_window_.width}));
  return from_display(picture, exposure, scan_.image_size().channels);
}

}  // namespace

std::unique_ptr<LightInterpolator> make_u_net_interpolator(const core::OlatScan& scan,
                                                           std::unique_ptr<const Network> network) {
  return std::make_unique<UNetInterpolator>(scan, std::move(network));
}

}  // namespace lightstage::model
