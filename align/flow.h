// Dense optical flow between pictures taken under the same light.
#pragma once

#include "core/image.h"

namespace lightstage::align {

// A flow field has two channels (dx, dy) in pixels: what is at p in the reference picture is at p + flow(p) in the other one.
using FlowField = core::Image;

// kFast and kMedium compute flow at a quarter and a half of the picture's size. kFine works at full size and refines the result on
// pictures that are not rounded to 8 bits: on textured pictures it is good to 0.02 px, where kMedium errs 0.05 and kFast 0.1.
enum class FlowPreset { kFast, kMedium, kFine };

// Dense inverse search (Kroeger et al. 2016) on display-encoded luminance, so that dark parts count, and for kFine a variational
// refinement (Brox et al. 2004). Pictures of equal size, 1 or 3 channels, linear, taken at one exposure (both are
// scaled by the reference's 99th percentile and clipped there, so that highlights, which do not move with the surface, count little).
// Where there is no texture the flow is what its surroundings have; 0 between even pictures. The same on any number of threads. About
// 1.2 us a pixel for kFine on one core. Throws BadInput when sizes differ or are below 16 pixels, or for values that are not finite.
FlowField compute_flow(core::ImageView reference, core::ImageView other, FlowPreset preset = FlowPreset::kFine);

// The picture as it would look in the reference's pose: out(p) = picture(p + flow(p)), bicubic. Pixels are squares about their centres:
// those whose source lies outside [-0.5, size - 0.5] are 0. A value may leave the range of the samples it is made of by a tenth of the
// range's end, no more, so that dark pixels beside highlights stay non-negative. No flow is no change, bit for bit.
// Throws BadInput when the flow is of another size, or for values that are not finite.
core::Image warp(core::ImageView picture, const FlowField& flow);

}  // namespace lightstage::align
