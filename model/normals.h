// Shape and colour of a scan's surface from its shading: photometric stereo.
#pragma once

#include "core/image.h"
#include "core/olat_scan.h"

namespace lightstage::model {

// Maps of the size of the scan's images.
struct SurfaceMaps {
  core::Image
      normals;  // 3 channels: x, y, z in the stage frame (docs/design.md), unit length; (0, 0, 1) where nothing is lit
  core::Image
      albedo;  // the channels of the images: radiance when faced by a unit light, so 1 for a white Lambertian surface; >= 0
  core::Image
      confidence;  // 1 channel in [0, 1]: the share of the lights before the surface that agree with the maps, over `condition`
  core::Image
      condition;  // 1 channel: by how much errors of values may grow in the normal, the condition number of the lights that
                  // agree, from 1 to 1e6, where fewer than three lights in general position do
};

// Per-pixel normal and albedo by robust least squares on the diffuse part of the pictures: lights that the pixel does not face, cast
// shadows and highlights are left out (model/classical/lambertian_fit.h). Lights are taken to be far away. Where fewer than three lights show a
// pixel the normal is the one nearest to them. Works with 1 GiB of pixels at a time, besides what the scan caches; 302 pictures of
// 256 x 256 pixels take a core about 2 s for a head before black, 5 s where noise leaves no pixel black. The same for every thread count. Throws
// Interrupted on Ctrl-C, and what loading throws.
SurfaceMaps estimate_normals(const core::OlatScan& scan);

}  // namespace lightstage::model
