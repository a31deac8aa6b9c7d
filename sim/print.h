// A flat print, held anywhere before a camera: the quick way to pictures of calibration boards, without meshes and lights.
#pragma once

#include "core/camera_model.h"
#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::sim {

// Print frame: metres, x right, y down in the picture, z away from who looks at it.
struct Print {
  core::Image picture;  // one channel: radiance of the evenly lit paper
  double metres_per_pixel = 0;
  double origin_px = 0;  // the frame's origin lies so many pixels right of and below the picture's top left corner
};

// What the camera sees, one channel, with the lens's distortion, a Gaussian blur of that standard deviation and square pixels (16 samples a
// pixel). The back of the print is not seen. `surroundings` is the radiance of everything else. No noise (sim/sensor.h adds it). About 0.3 s a megapixel and
// thread. Throws BadInput for a print without pixels or size.
core::Image photograph(const core::CameraModel& camera, const Print& print,
                       const core::RigidTransform& stage_from_print, double blur_px = 0.45, float surroundings = 0.15F);

}  // namespace lightstage::sim
