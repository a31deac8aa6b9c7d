// Pictures as a pinhole camera in the lens's place would have taken them.
#pragma once

#include "core/camera_model.h"
#include "core/image.h"

namespace lightstage::core {

// The camera without its distortion: same place, size, focal lengths and principal point.
CameraModel pinhole_of(const CameraModel& camera);

// For each pixel of `pinhole` where the lens put what it shows, in pixels of the picture that `camera` took: (x, y), two channels. NaN where
// the camera did not see it: outside its picture, or beyond the place where its distortion folds. Only intrinsics count: both cameras stand
// in one place and look one way. Exactly camera.project() of pinhole.ray(). Throws BadInput for a pinhole that has distortion.
Image undistortion_map(const CameraModel& camera, const CameraModel& pinhole);

struct Undistorted {
  Image picture;  // of the pinhole's size; 0 where the camera did not see
  Image mask;     // one channel: 1 where it did, else 0
};

// The picture resampled by sample_cubic. Any number of channels: masks and normal maps too, the latter without being
// turned, since the viewing direction stays. About 0.4 s a megapixel and thread. Throws BadInput as undistortion_map, and for a picture that is not of the camera's size or
// not finite.
Undistorted undistort(ImageView picture, const CameraModel& camera, const CameraModel& pinhole);
inline Undistorted undistort(ImageView picture, const CameraModel& camera) {
  return undistort(picture, camera, pinhole_of(camera));
}

}  // namespace lightstage::core
