// The pictures of a scan taken apart into what moves differently when the light does.
#pragma once

#include <cstddef>

#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"
#include "model/normals.h"

namespace lightstage::model {

// The layers of one picture, I = D V + S and what is left; each of its size.
struct Layers {
  core::Image diffuse;     // D: albedo times the cosine to the light, 0 where the surface faces away; linear radiance
  core::Image highlights;  // S: what the picture has above that, 0 or more; linear radiance
  // Signed distance to the edge of cast shadows, pixels, within +-shadow_reach(), 1 channel: positive in the light, negative in shadow. A pixel is in
  // shadow where it shows less than half of its diffuse layer; where that is too little to tell (grazing light, black surface) the distance goes on from
  // where it is known.
  core::Image shadow_distance;
};

// After Fuchs et al. 2007, "Superresolution reflectance fields: synthesizing images for intermediate light directions", which treats highlights and
// shadows apart from what can be blended. All functions may be called from several threads and give the same result on any number of them.
class LightLayers {
 public:
  // Takes what estimate_normals takes.
  explicit LightLayers(const core::OlatScan& scan);

  const core::OlatScan& scan() const { return scan_; }

  // D under a light from anywhere: the one layer that the surface determines.
  core::Image diffuse(const core::Direction& direction) const;

  // Of a captured light. Throws what loading its picture throws.
  Layers of(std::size_t light) const;

  // How far from an edge its distance is still told, pixels: about as far as shadows move from one light to the next.
  double shadow_reach() const { return shadow_reach_; }

 private:
  core::Image shadow_distance(core::ImageView diffuse, core::ImageView picture) const;

  core::OlatScan scan_;
  SurfaceMaps surface_;
  double shadow_reach_;
};

// The share of light that comes through at a signed distance from a shadow's edge: from 0 to 1 across the one pixel about it.
inline double visibility(double shadow_distance) {
  const double share = shadow_distance + 0.5;
  return share < 0 ? 0 : share > 1 ? 1 : share;
}

}  // namespace lightstage::model
