// A perspective camera with Brown-Conrady distortion, in OpenCV's conventions: camera axes x right, y down, z
// forward; pixel centres at integer coordinates, so the image spans [-0.5, width - 0.5].
#pragma once

#include <optional>

#include "core/vec3.h"

namespace lightstage::core {

struct Pixel {
  double x = 0, y = 0;
};

struct CameraModel {
  int width = 0, height = 0;         // pixels
  double fx = 0, fy = 0;             // focal lengths, pixels
  double cx = 0, cy = 0;             // principal point, pixels
  double k1 = 0, k2 = 0, k3 = 0;     // radial distortion
  double p1 = 0, p2 = 0;             // tangential distortion
  RigidTransform stage_from_camera;  // metres

  // The pixel in which a stage point is seen; nothing when it lies on or behind the camera plane.
  std::optional<Pixel> project(Vec3 stage_point) const;
  // Where the viewing ray starts and goes (unit vector), in the stage frame. Inverts the distortion by
  // Newton's method to 1e-12 of the normalised image plane. Throws BadInput where the distortion has no
  // inverse (far outside the image).
  Vec3 centre() const { return stage_from_camera.translation; }
  Vec3 ray(Pixel pixel) const;
  // The same ray in the camera frame.
  Vec3 ray_in_camera(Pixel pixel) const;
};

// A camera at `position` that looks at `target` with image up along stage y, horizontal field of view in
// degrees, no distortion. Throws BadInput when position and target coincide or look along y.
CameraModel look_at(Vec3 position, Vec3 target, int width, int height, double field_of_view_degrees);

}  // namespace lightstage::core
