#include "calib/ball/hit.h"

#include <cmath>

#include "core/error.h"
#include "core/image_file.h"

namespace lightstage::calib {

using core::Vec3;

std::optional<BallHit> hit_ball(const core::CameraModel& camera, const Sphere& ball, core::Pixel pixel) {
  const Vec3 to_centre = ball.centre - camera.centre();
  const Vec3 view = camera.ray(pixel);
  const double along = dot(to_centre, view);
  // The ray's nearest point to the centre; from it half the chord, without a difference of large squares.
  const Vec3 nearest = view * along - to_centre;
  const double miss = norm(nearest) / ball.radius_m;
  if (!(along > 0) || !(miss < 1)) return std::nullopt;
  return BallHit{view, nearest / ball.radius_m - view * std::sqrt((1 - miss) * (1 + miss)), miss};
}

void require_picture_of(core::ImageView picture, const core::CameraModel& camera, const std::string& what) {
  if (picture.width() != camera.width || picture.height() != camera.height) {
    throw core::BadInput(what + ": the picture has " + std::to_string(picture.width()) + " x " +
                         std::to_string(picture.height()) + " pixels, the camera " + std::to_string(camera.width) +
                         " x " + std::to_string(camera.height));
  }
  core::require_finite(picture, what);
}

}  // namespace lightstage::calib
