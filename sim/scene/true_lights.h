// Where a stage's lights really are and how bright: its drawing disturbed as its StageSimulation says.
#pragma once

#include <vector>

#include "capture/stage.h"
#include "core/light_list.h"

namespace lightstage::sim {

// Each light is disturbed by its own random numbers, by index: adding lights changes none of the others. The
// direction moves by a normal angle of standard deviation mount_error_degrees along each of two tangents, at
// the drawn distance; the logarithms of the gains are normal with standard deviation gain_spread, three
// quarters of their variance common to the channels (brightness) and one quarter each channel's own (colour).
// Throws BadInput for a light at stage centre or a dead light that does not exist.
std::vector<core::Light> true_lights(const capture::Stage& stage);

}  // namespace lightstage::sim
