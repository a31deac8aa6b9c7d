// A polished ball: what calibration looks at to find the lights.
#pragma once

#include <span>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::sim {

constexpr double kMirrorReflectance = 0.9;
// The polished ball is a little dusty: this Lambertian albedo is added to its reflections.
constexpr double kMirrorDust = 0.01;
// The room beyond the stage is dim and even. Its radiance for lights of one unit of gain in total.
constexpr double kRoomRadiance = 0.01;

// A lamp: a disc that faces stage centre, of radiance falling off smoothly over its outer fifth, and such
// that its irradiance there is pi * gain.
struct Lamp {
  core::Vec3 position;  // of the disc's centre
  double radius = 0;
  std::array<double, 3> gain{};
};

// The point of a ball at the origin in which a viewer sees a point reflected (Alhazen's problem; both outside
// the ball); nothing when the ball itself hides it.
std::optional<core::Vec3> reflection_point(double ball_radius, core::Vec3 viewer, core::Vec3 seen);

// Adds the lamps' reflections in a ball at the origin to a picture. A disc is cut into cells small against a
// pixel; each cell's corners are followed to the picture through their reflection points; the cell then
// covers the area of its image with the lamp's radiance (which reflection keeps), seen through
// pixel_response. Exact but for the size of the cells, however small the highlight is. `camera` is placed in
// the ball's frame.
void add_reflections(core::Image& image, const core::CameraModel& camera, double ball_radius,
                     std::span<const Lamp> lamps);

}  // namespace lightstage::sim
