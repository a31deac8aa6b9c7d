// The super-resolution network as a LightInterpolator (Sun et al. 2020, "Light Stage Super-Resolution"; docs/model.md draws it).
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>

#include "core/olat_scan.h"
#include "model/interpolator.h"

namespace lightstage::model {

// Reads the checkpoint (model/checkpoint.h) once. A query takes the checkpoint's number of nearest lights (fewer where the scan has
// fewer) and blends their images per pixel, display-encoded; outside the mask's bounding box it is linear blending. The encoding of a
// captured image does not depend on the query and is kept after its first use, in at most `cache_bytes` (about 4 bytes x 40 x pixels of
// the bounding box an image for preset tiny; least recently used go first). Results do not depend on what is cached. Throws
// BadInput for a checkpoint that is missing, damaged or of another version.
std::unique_ptr<LightInterpolator> make_superres(const core::OlatScan& scan, const std::filesystem::path& checkpoint,
                                                 std::size_t cache_bytes = std::size_t(2) << 30);

}  // namespace lightstage::model
