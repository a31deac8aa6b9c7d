#include "core/undistortion.h"

#include <cmath>
#include <limits>
#include <string>

#include "core/cubic_sampling.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"

namespace lightstage::core {

namespace {

constexpr std::size_t kRowsAtATime = 8;

// Whether the lens really puts this ray there: past a fold other rays come to the same place.
bool seen_there(const CameraModel& camera, Pixel place, Vec3 unit_ray) {
  constexpr double kSame = 1e-6;
  try {
    return norm(camera.ray_in_camera(place) - unit_ray) < kSame;
  } catch (const BadInput&) {
    return false;
  }
}

}  // namespace

CameraModel pinhole_of(const CameraModel& camera) {
  CameraModel pinhole = camera;
  pinhole.k1 = pinhole.k2 = pinhole.k3 = pinhole.p1 = pinhole.p2 = 0;
  return pinhole;
}

Image undistortion_map(const CameraModel& camera, const CameraModel& pinhole) {
  if (pinhole.k1 != 0 || pinhole.k2 != 0 || pinhole.k3 != 0 || pinhole.p1 != 0 || pinhole.p2 != 0) {
    throw BadInput("undistortion: the camera to be had has distortion itself");
  }
  CameraModel lens = camera;
  lens.stage_from_camera = {};
  Image map(pinhole.height, pinhole.width, 2);
  parallel_for(std::size_t(pinhole.height), kRowsAtATime, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y) {
      for (int x = 0; x < pinhole.width; ++x) {
        const Vec3 ray = pinhole.ray_in_camera({double(x), double(y)});
        const std::optional<Pixel> place = lens.project(ray);
        const bool inside = place && place->x >= -0.5 && place->x <= camera.width - 0.5 && place->y >= -0.5 &&
                            place->y <= camera.height - 0.5;
        const bool seen = inside && seen_there(lens, *place, ray);
        map(y, x, 0) = seen ? float(place->x) : std::numeric_limits<float>::quiet_NaN();
        map(y, x, 1) = seen ? float(place->y) : std::numeric_limits<float>::quiet_NaN();
      }
    }
  });
  return map;
}

Undistorted undistort(ImageView picture, const CameraModel& camera, const CameraModel& pinhole) {
  if (picture.width() != camera.width || picture.height() != camera.height || picture.empty()) {
    throw BadInput("undistortion: the picture is " + std::to_string(picture.width()) + " x " +
                   std::to_string(picture.height()) + " pixels, its camera's are " + std::to_string(camera.width) +
                   " x " + std::to_string(camera.height));
  }
  require_finite(picture, "undistortion: the picture");
  const Image map = undistortion_map(camera, pinhole);
  Undistorted result{Image(pinhole.height, pinhole.width, picture.channels()), Image(pinhole.height, pinhole.width, 1)};
  parallel_for(std::size_t(pinhole.height), kRowsAtATime, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y) {
      for (int x = 0; x < pinhole.width; ++x) {
        if (std::isnan(map(y, x, 0))) continue;
        sample_cubic(picture, double(map(y, x, 0)), double(map(y, x, 1)), result.picture.pixel(y, x));
        result.mask(y, x) = 1;
      }
    }
  });
  return result;
}

}  // namespace lightstage::core
