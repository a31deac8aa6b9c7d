// Pictures of balls as a camera would take them, computed from geometry alone.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::test {

// A lamp: a disc facing stage centre. Unit gain gives irradiance pi at stage centre.
struct Lamp {
  core::Vec3 position;
  double radius_m = 0.012;
  double gain = 1;
};

// A camera 1.9 m in front of stage centre that sees a third of a metre in `pixels` pixels, with barrel
// distortion.
core::CameraModel stage_camera(int pixels);

// Lamps about uniformly around stage centre at `radius_m`, each turned off its place at random by
// `error_degrees`.
std::vector<Lamp> stage_lamps(std::size_t n, double radius_m, double error_degrees, std::uint64_t seed);

// Reflections of the lamps in a polished ball: radiance times reflectance 0.9, each disc cut into points that
// are seen through the pixel's area and a Gaussian lens blur. One channel.
core::Image mirror_reflections(const core::CameraModel& camera, const calib::Sphere& ball,
                               const std::vector<Lamp>& lamps, double blur_px);

// A Lambertian ball lit by the lamps, no shadows but its own, seen through the same blur. One channel.
core::Image lambertian_ball(const core::CameraModel& camera, const calib::Sphere& ball, const std::vector<Lamp>& lamps,
                            double albedo, double blur_px);

core::Image sum(const core::Image& a, const core::Image& b, float factor_b = 1);

// Shot noise of 12000 electrons at 1, read noise of 6, clipped at 1, 12 bits; then divided by `exposure`, by
// which the radiance was multiplied before: saturation is 1 / exposure.
core::Image through_sensor(const core::Image& radiance, double exposure, std::uint64_t seed);

// Degrees between two vectors.
double degrees_between(core::Vec3 a, core::Vec3 b);
double median(std::vector<double> values);
double percentile(std::vector<double> values, double share);

}  // namespace lightstage::test
