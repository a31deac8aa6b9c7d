// Dense optical flow between pictures taken under the same light.
#pragma once

#include "core/image.h"

namespace lightstage::align {

// A flow field has two channels (dx, dy) in pixels: what is at p in the reference picture is at p + flow(p) in the other one.
using FlowField = core::Image;

enum class FlowPreset { kFast, kMedium, kFine };

// Dense inverse search (Kroeger et al. 2016) on display-encoded luminance, so that dark parts count. Pictures of equal size, 1 or 3 channels, linear,
// any exposure (both are scaled by the reference's 99th percentile). Throws BadInput when sizes differ or are below 16 pixels.
FlowField compute_flow(core::ImageView reference, core::ImageView other, FlowPreset preset = FlowPreset::kFine);

// The picture as it would look in the reference's pose: out(p) = picture(p + flow(p)), bicubic; pixels whose source lies outside the
// picture are 0. Overshoot of the kernel is clamped to the range of its neighbours, so that dark pixels stay non-negative.
core::Image warp(core::ImageView picture, const FlowField& flow);

}  // namespace lightstage::align
