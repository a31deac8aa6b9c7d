// Where a camera's picture is sampled, and how samples become pixels.
#pragma once

#include <vector>

#include "core/camera_model.h"

namespace lightstage::sim {

// What a pixel sees of its surroundings: the lens's point spread (a Gaussian) over the pixel's square
// aperture, which is h(x) h(y) with
//   h(x) = (erf((x + 1/2) / (s sqrt 2)) - erf((x - 1/2) / (s sqrt 2))) / 2,
// s = kLensBlur. Without blur, a highlight smaller than a pixel would not show where in the pixel it lies.
constexpr double kLensBlur = 0.45;  // pixels
constexpr int kFilterReach = 2;     // pixels beyond the pixel's own; what lies outside adds less than 1e-5
double pixel_response(double offset);

// Weights of the samples from `reach` pixels left of a pixel to `reach` pixels right of it, `per_side`
// samples a pixel; they sum to 1.
std::vector<float> filter_weights(int per_side);

// A regular grid of `per_side` x `per_side` samples a pixel over the image and kFilterReach pixels around it,
// as directions in the camera frame, (x, y, 1).
class SampleGrid {
 public:
  SampleGrid(const core::CameraModel& camera, int per_side);

  int per_side() const { return per_side_; }
  int image_width() const { return image_width_; }
  int image_height() const { return image_height_; }
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  // Unit length.
  core::Vec3 ray_in_camera(int row, int column) const;

 private:
  struct Slope {
    float x, y;
  };
  int per_side_, image_width_, image_height_, columns_, rows_;
  std::vector<Slope> slopes_;
};

}  // namespace lightstage::sim
