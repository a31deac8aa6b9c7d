// Aligning a set of pictures that has no tracking frames.
#pragma once

#include <string>

#include "cli/jobs/align.h"
#include "db/store.h"

namespace lightstage::cli {

struct RegisterReport {
  std::size_t aligned = 0;      // frames
  double median_motion_px = 0;  // undone
  double largest_motion_px = 0;
  double residual_before_px = 0;  // median over pictures of the flow from what their neighbours predict
  double residual_after_px = 0;
  std::vector<ExcludedFrame> excluded;
};

// For every camera: the pictures under single lights are registered with each other (align/registration.h), and stored as an "alignment"
// product like that of align_scan, without flows. Lights without a direction, and pictures that could not be registered, are of role
// "excluded". Throws UsageError for a scan of fewer than 3 lights or one whose lights' directions are not known, and BadInput when more than
// half of a camera's pictures cannot be registered.
RegisterReport register_scan(db::Store& store, const db::Scan& scan);

}  // namespace lightstage::cli
