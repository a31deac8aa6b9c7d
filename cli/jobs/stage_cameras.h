// The cameras of a captured scan as far as they are known.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "cli/jobs/provenance.h"
#include "db/store.h"

namespace lightstage::cli {

// capture_provenance with each camera's lens and pose as the stage's newest camera calibration has them, if there is one. Cameras that it does
// not name, or that took pictures of another size, stay as drawn, with a warning. For everything that
// measures in pictures; the simulator's truth is in the cameras as drawn (capture_provenance).
CaptureProvenance calibrated_provenance(const db::Store& store, const db::Scan& scan);

// A camera in a product's parameters.
nlohmann::ordered_json camera_json(const capture::StageCamera& camera);

}  // namespace lightstage::cli
