// The part of a map that captured lights carry as well as any others could.
#pragma once

#include <span>
#include <vector>

#include "core/vec3.h"
#include "model/interpolator.h"
#include "relight/environment.h"
#include "relight/light_differences.h"

namespace lightstage::relight {

// By patch, whose nearest lights are given, the irradiance of the smooth part of the map: the light around each captured light, as the median (a channel at a time) of the mean radiances
// around it and around its neighbours, and between captured lights by barycentric interpolation of those. So slopes are smooth, and a small source is no part
// of it, however bright. May be more than the patch has. Within holes of the stage nothing is smooth: errors
// there do not change their sign. `barycentric` is that method on the scan, in the linear domain.
std::vector<core::Vec3> smooth_light(std::span<const Patch> patches,
                                     std::span<const LightDifferences::NearestLight> nearest,
                                     const LightDifferences& lights, const model::LightInterpolator& barycentric);

}  // namespace lightstage::relight
