// Calibrated lights as files for other programs, and as a picture to look at.
#pragma once

#include <filesystem>

#include "cli/jobs/join_lights.h"
#include "core/image.h"

namespace lightstage::cli {

// lights.lp (RTI), lights.dome, lights.csv and lights.png into the folder, which is made where there is none. Only lights that are used
// are in the first two, which are not written when there are none. The .dome file is the JSON that Relight (Visual Computing Lab, CNR-ISTI) reads and writes (keys and structure as in its
// source, cnr-isti-vclab/relight, src/dome.cpp): lightConfiguration "directional" and `directions` [{x, y, z}], or "lights3d" with
// positions3d too where positions are known; where the stage's radius is known also domeDiameter and positionsSphere.
void write_light_files(const std::filesystem::path& folder, const LightSources& sources, const LightsReport& report);

// Every view's brightest values over all lights with the ball's outline and the highlights found (green: used, red: not), and the sphere of lights
// (seen from +z, angle from +z outwards; the ring is 90 degrees) with each light's views joined to it by lines drawn ten times as long as
// they are.
core::Image light_picture(const LightSources& sources, const LightsReport& report);

}  // namespace lightstage::cli
