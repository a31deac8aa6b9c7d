// A scan of very many lights as few pictures, for relighting it at once.
//
// The pictures of a scan, one row a light and one column a masked value, are nearly dependent: picture_i = sum_k coefficient_ik basis_k with far fewer basis
// pictures than lights (a truncated singular value decomposition). Any light is then a colour for each basis picture and one short sum; this
// is exact relighting of slightly changed pictures, so energy and everything else linear holds to the pack's error. Linear light
// is what is decomposed: of display-encoded values no sum would be a picture. What the error amounts to on a screen is measured beside it.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "core/image.h"
#include "core/olat_scan.h"
#include "model/interpolator.h"

namespace lightstage::relight {

// Measured after rounding, picture by picture, inside the mask.
struct PackErrors {
  double relative =
      0;  // the root of the mean square over lights and values, each light weighted by its solid angle, over that of the pictures
  double largest_light = 0;  // the same of the single picture that came out worst, over the same mean of all pictures
  double display = 0;  // of display-encoded values, as `evaluate` gives rmse; of at most 64 lights spread over all
};

struct LightPack {
  std::vector<core::Image>
      basis;  // pixels inside the mask alone, row after row: 1 x pixels x 1 or 3; values that half floats hold exactly
  std::vector<double> coefficients;  // lights x rank()
  PackErrors errors;
  std::size_t rank() const { return basis.size(); }
};

// What a pack may be asked for. A scan in the store is rounded to half floats itself, which is an error of 0.0003: to ask for much less is to keep the rounding.
inline constexpr double kLeastPackError = 0.001, kMostPackError = 0.5;

// The fewest basis pictures that keep `error` (PackErrors::relative), rounded. Lights count by the solid angle nearest to them, so that the error is that of
// relighting by environments alike on all sides. Values are rounded to steps that are the same for all basis pictures in units of the scan's own values and together
// make an eighth of the error: where a basis picture hardly matters few steps are left of it, which compresses well. `exposure` is the value that is shown as 1
// (core::OlatScan::exposure() of this scan or of the one that it was made from). Two passes over the pictures; time and memory as
// model::leading_basis. The result does not depend on the thread count. Throws UsageError for an error or exposure out of range, Interrupted, and what
// loading a picture throws.
LightPack compress(const core::OlatScan& scan, double error, double exposure);

// The pixels inside the mask (above 0.5), in rows from the top: 1 x pixels x channels, 3 for pictures of more than one.
core::Image masked_pixels(core::ImageView image, const core::Image& mask);
// The picture with these pixels inside the mask and 0 outside. Throws BadInput for another number of them.
core::Image unmasked(core::ImageView pixels, const core::Image& mask);

// The packed scan as a method: barycentric weights between its lights, and the pack for their pictures. Black outside the mask.
class PackedScan final : public model::LightInterpolator {
 public:
  // `scan` is the one that was packed; its pictures are not loaded. Throws BadInput when the pack is not of its lights and mask.
  PackedScan(LightPack pack, const core::OlatScan& scan);

  std::string_view name() const override { return "pack"; }
  const core::OlatScan& scan() const override { return between_lights_->scan(); }
  core::Image render(const core::Direction& query) const override;
  std::vector<double> linear_weights(const core::Direction& query) const override;
  std::vector<core::Vec3> captured_colours(std::span<const model::DistantLight> lights) const override;
  // lights x rank and rank x masked values operations.
  core::Image lit_by(std::span<const core::Vec3> colours) const override;

  std::size_t rank() const { return pack_.rank(); }
  const PackErrors& errors() const { return pack_.errors; }

 private:
  LightPack pack_;  // with 3 channels
  std::unique_ptr<model::LightInterpolator> between_lights_;
};

}  // namespace lightstage::relight
