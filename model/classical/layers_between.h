// The layers of the picture under a light where none stood, from those of the lights around it.
#pragma once

#include <vector>

#include "model/classical/light_layers.h"

namespace lightstage::model {

// A captured light near the query, with what its picture is made of.
struct NearLight {
  std::size_t light = 0;
  double weight = 0;  // W, above 0; all sum to 1
  Layers layers;
};

struct LayersBetween {
  std::vector<NearLight> lights;
  core::Image diffuse;     // D(q), linear radiance
  core::Image highlights;  // S(q), linear radiance
  core::Image visibility;  // V(q) in [0, 1], 1 channel
};

// With the alias-free weights W of the six nearest lights (model/alias_free_weights.h), five of which count:
//   S(q) = sum_i W_i [S_i moved by sum_j W_j flow_ij]  (model/classical/highlight_motion.h), so that each highlight moves to the mean place of its likes;
//   V(q) = visibility(phi / (1 + 0.6 sum_i W_i |phi_i - phi|)),  phi = sum_i W_i phi_i, with the signed distances phi_i of the shadow edges (their
//          interpolation is that of level sets: Osher and Sethian 1988, "Fronts propagating with curvature-dependent speed"; Fuchs et al. 2007): an edge
//          moves with the light, and is as soft as a share of the way it moves. phi_i counts at most as far as lights and shadows nearby are deep, so that a
//          shadow too thin to have moved is blended, not outvoted.
// Continuous in the query, and the layers of a captured light at that light. At 256 x 256 pixels 0.2 to 0.5 s a core, most of it for the flow.
LayersBetween layers_between(const LightLayers& scan, const core::Direction& query);

}  // namespace lightstage::model
