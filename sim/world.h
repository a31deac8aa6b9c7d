// The simulated scene: true lights, a moving subject, cameras that see radiance. Tests and evaluation may ask it for truth;
// nothing on the way from capture to pictures may.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "capture/sequence.h"
#include "core/camera_model.h"
#include "core/clock.h"
#include "core/direction.h"
#include "core/image.h"
#include "core/light_list.h"
#include "sim/simulation.h"

namespace lightstage::sim {

// Lights are discs at finite distance (points for shadows), each with irradiance pi * gain at stage centre and inverse-square
// falloff: a white Lambertian surface facing a light of unit gain at stage centre has radiance 1. Materials are diffuse plus GGX
// (Walter et al. 2007, with Smith masking and Schlick's Fresnel). Shadows are hard; under more than 16 lights at once they are
// interpolated between the vertices of the mesh (PSNR above 35 dB against the sum of single lights). A pixel sees its surroundings
// through the lens's point spread (a Gaussian, standard deviation 0.45 pixels) over its square aperture, so that a highlight smaller
// than a pixel still shows where in it it lies. Results do not depend on the thread count. All functions may be called from several
// threads.
class World {
 public:
  // Builds meshes and acceleration structures. Throws BadInput for a mesh file that is missing, damaged, changed
  // since the simulation was recorded, or without triangles, and for values that make no sense (naming them).
  explicit World(const Simulation& simulation);
  ~World();
  World(World&&) noexcept;

  const Simulation& simulation() const;

  // Lights where they really are, with their real gains (0 for dead ones).
  const std::vector<core::Light>& true_lights() const;

  // Radiance (RGB) seen by a camera of the stage when `levels` are lit and the subject is in its pose of time `t` (ns since the
  // sequence began). No noise. The lens's distortion is in it, vignetting is the sensor's. Throws BadInput for a light that does
  // not exist. At 256 x 256 pixels about 0.12 s a core for one light and 0.25 s for 200 (0.7 s more the first time).
  core::Image render(const core::CameraModel& camera, std::span<const capture::LightLevel> levels,
                     core::Nanoseconds t) const;

  // The same pose under single lights of unit gain at stage radius in any directions, the truth between the stage's lights; one
  // image a direction. Visibility from the camera is computed once for all of them.
  std::vector<core::Image> render_directions(const core::CameraModel& camera,
                                             std::span<const core::Direction> directions, core::Nanoseconds t) const;

  // Share of each pixel covered by the subject, one channel in [0, 1].
  core::Image coverage(const core::CameraModel& camera, core::Nanoseconds t) const;

  // Where the surface seen at each pixel at time `from` is seen at time `to`, relative to the pixel: (dx, dy) in pixels, two
  // channels; NaN where no surface is seen. Occlusion at `to` is not considered.
  core::Image true_flow(const core::CameraModel& camera, core::Nanoseconds from, core::Nanoseconds to) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lightstage::sim
