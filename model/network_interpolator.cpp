#include "model/network_interpolator.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "core/error.h"
#include "core/sphere.h"
#include "model/classical.h"
#include "model/engine/engine_interpolator.h"
#include "model/net/blend_network.h"
#include "model/net/network_file.h"
#include "model/net/pixels.h"
#include "model/net/u_net_interpolator.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

class BlendInterpolator : public LightInterpolator {
 public:
  BlendInterpolator(const core::OlatScan& scan, std::unique_ptr<const BlendNetwork> network)
      : scan_(scan),
        encoded_(scan.display_encoded()),
        network_(std::move(network)),
        guide_(make_rbf(scan, Domain::kDisplay)),
        spacing_(core::median_spacing_radians(scan.directions())),
        mask_window_(bounding_window(scan.mask())),
        coarseness_(BlendNetwork::coarseness(std::max(mask_window_.height, mask_window_.width))),
        window_(rounded_up(mask_window_, coarseness_ * network_->size_multiple())) {
    prepare_torch();
  }

  std::string_view name() const override { return architecture_name(Architecture::kBlend); }
  const core::OlatScan& scan() const override { return scan_; }
  core::Image render(const core::Direction& query) const override;

 private:
  core::OlatScan scan_, encoded_;
  std::unique_ptr<const BlendNetwork> network_;
  std::unique_ptr<LightInterpolator> guide_;
  double spacing_;
  Window mask_window_;
  int coarseness_;  // so that the subject has the size of those in training
  Window window_;   // mask_window_, grown to the sizes that the network takes
};

core::Image BlendInterpolator::render(const core::Direction& query) const {
  const c10::InferenceMode inference;
  const std::vector<core::Direction>& lights = scan_.directions();
  const ActiveSet set = network_->active_set(
      query, lights, core::nearest_indices(lights, query, std::size_t(network_->config().neighbours)), spacing_);
  const double exposure = scan_.exposure();

  const Tensor guide = to_display(guide_->render(query), exposure).unsqueeze(0);
  const Tensor inside =
      network_->predict(pictures_in(encoded_, set.lights, window_), cut(guide, window_), set, coarseness_);

  Tensor picture = guide.clone();  // outside the mask's window
  cut(picture, mask_window_).copy_(cut(inside, {0, 0, mask_window_.height, mask_window_.width}).clamp_min(0));
  return from_display(picture, exposure, scan_.image_size().channels);
}

}  // namespace

std::unique_ptr<LightInterpolator> make_network_interpolator(const core::OlatScan& scan,
                                                             const std::filesystem::path& checkpoint,
                                                             const NetworkOptions& options) {
  std::unique_ptr<Network> network = load_network(checkpoint, options.neighbours);
  if (const auto* superres = dynamic_cast<const SuperresNetwork*>(network.get())) {
    return make_engine_interpolator(
        scan, *superres,
        {.products = options.bfloat16 ? Number::kBfloat16 : Number::kFloat32,
         .storage = options.bfloat16 || options.half_storage ? Number::kFloat16 : Number::kFloat32,
         .budget = {.memory_bytes = options.cache_bytes, .spill_bytes = options.spill_bytes}});
  }
  if (dynamic_cast<const BlendNetwork*>(network.get())) {
    return std::make_unique<BlendInterpolator>(
        scan, std::unique_ptr<const BlendNetwork>(static_cast<const BlendNetwork*>(network.release())));
  }
  return make_u_net_interpolator(scan, std::move(network));
}

}  // namespace lightstage::model
