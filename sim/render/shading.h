// Light reflected at one point: diffuse plus GGX.
#pragma once

#include <span>
#include <vector>

#include "sim/render/subject.h"

namespace lightstage::sim {

// Lights as columns, so that the loop over them is vector code. Frame: the subject's.
struct LightSet {
  std::vector<float> x, y, z;  // metres
  std::vector<float> red, green,
      blue;                // gain times squared distance from stage centre: gain/r^2 falls off from there
  std::vector<int> index;  // in the stage; -1 for a light that is not one of the stage's

  std::size_t size() const { return x.size(); }
  bool empty() const { return x.empty(); }
  Vec3f position(std::size_t i) const { return {x[i], y[i], z[i]}; }
  // `centre_distance` is the light's distance from stage centre, where its irradiance is pi * gain.
  void add(Vec3f position, double centre_distance, std::span<const double, 3> gain, int light_index);
};

// Radiance towards the viewer: sum over the lights of pi gain (d/r)^2 visibility cos f_r, with
//   f_r = albedo/pi (1 - F(n.l)) (1 - F(n.v)) + D V F(h.v),
// D the GGX distribution, V = G2 / (4 n.l n.v) its height-correlated Smith masking (Walter et al. 2007; Heitz
// 2014, "Understanding the masking-shadowing function", eq. 99), F Schlick's Fresnel with 1 at grazing.
// Symmetric in l and v, and never reflects more than it receives. A sample with f0 = 0 is Lambertian.
Vec3f reflected_radiance(const SurfaceSample& sample, const LightSet& lights, std::span<const float> visibility);

}  // namespace lightstage::sim
