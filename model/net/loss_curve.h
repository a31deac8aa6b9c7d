// The course of a training run as a table and as a picture.
#pragma once

#include <span>
#include <string>

#include "core/image.h"
#include "model/training.h"

namespace lightstage::model {

// Titles, the guide at step 0, and a line a point.
std::string loss_curve_csv(std::span<const LossPoint> curve, double guide_validation);

// Training and validation error over steps, the error on a logarithmic axis, and the guide's validation error as a level line; values as stored in 8-bit
// files, 0 to 1. Points that are not finite or not > 0 are left out.
core::Image draw_loss_curve(std::span<const LossPoint> curve, double guide_validation);

}  // namespace lightstage::model
