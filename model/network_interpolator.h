// A trained network as a LightInterpolator (docs/model.md draws both networks).
#pragma once

#include <filesystem>
#include <memory>

#include "core/olat_scan.h"
#include "model/interpolator.h"

namespace lightstage::model {

// Reads the checkpoint (model/checkpoint.h) once; the method is named as its architecture. A query takes the checkpoint's number of nearest lights
// (fewer where the scan has fewer); outside the mask's bounding box the picture is that of thin-plate interpolation. Throws BadInput for a
// checkpoint that is missing, damaged or of another version.
std::unique_ptr<LightInterpolator> make_network_interpolator(const core::OlatScan& scan,
                                                             const std::filesystem::path& checkpoint);

}  // namespace lightstage::model
