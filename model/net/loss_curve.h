// The course of a training run as a table and as a picture.
#pragma once

#include <span>
#include <string>

#include "core/image.h"
#include "model/training.h"

namespace lightstage::model {

// Titles, the validation error before the first step, and a line a point.
std::string loss_curve_csv(std::span<const LossPoint> curve, double first_validation);

// Training and validation error over steps, the latter from before the first one, the error on a logarithmic axis, and the guide's validation
// error as a level line; values as stored in 8-bit files, 0 to 1. Points that are not finite or not > 0 are left out.
core::Image draw_loss_curve(std::span<const LossPoint> curve, double first_validation, double guide_validation);

}  // namespace lightstage::model
