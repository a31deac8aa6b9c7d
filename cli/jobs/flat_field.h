// Flat fields from passes in the store, and into the store.
#pragma once

#include <string>

#include "calib/flat_field.h"
#include "db/store.h"

namespace lightstage::cli {

// From the light frames of a pass that shows a white card at the stage's centre, facing the primary camera and filling the picture. How much of each
// light falls where on the card follows from the lights' places (the stage's newest calibration, else as drawn); lights more than 60 degrees off the
// card's normal are left out, and so are overexposed frames. Throws UsageError for a scan that was not captured, BadInput naming scan and camera where the frames show no such card.
calib::FlatField flat_from_pass(const db::Store& store, const db::Scan& scan, const std::string& camera,
                                const calib::FlatOptions& options);

// As the newest flat field of the stage's camera: loading divides its frames by it (db/scan_loader.h).
void store_flat_field(db::Store& store, const db::Scan& scan, const std::string& camera, const calib::FlatField& field,
                      bool of_scan);

}  // namespace lightstage::cli
