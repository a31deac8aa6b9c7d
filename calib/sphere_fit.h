// Where a ball of known radius is, from its outline in one picture.
#pragma once

#include "core/camera_model.h"
#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::calib {

struct Sphere {
  core::Vec3 centre;  // metres, stage frame
  double radius_m = 0;
  double outline_rms_px = 0;  // distance of outline points from the fitted outline
  int outline_points = 0;     // that agree with it
};

// `picture` shows the ball brighter than its surroundings (a full-on frame); highlights on it may clip. Outline points are found with
// sub-pixel precision across the expected outline by fitting how a lit ball's brightness ends at its rim. Viewing rays tangent to a
// sphere make one angle with the ray to its centre, so (with rays r_i and axis a) r_i . a / cos(angle) = 1 is linear in
// a / cos(angle): solved by least squares, robustly (iteratively reweighted), which is exact in perspective where a circle fit to the image
// is not. Stands, reflected lamps and the picture's border may spoil up to a third of the outline. Typical errors are below
// 0.05 px sideways and in radius. Throws BadInput (what to do included) when no bright blob stands out, it is smaller
// than 16 px across, its outline is cut by the frame over more than a third, or it is no sphere's.
Sphere locate_sphere(core::ImageView picture, const core::CameraModel& camera, double radius_m);

}  // namespace lightstage::calib
