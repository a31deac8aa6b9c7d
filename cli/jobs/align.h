// Aligning a captured scan to the pose of its key frame.
#pragma once

#include <string>
#include <vector>

#include "align/flow.h"
#include "align/motion_track.h"
#include "db/store.h"

namespace lightstage::cli {

struct AlignOptions {
  align::FlowPreset preset = align::FlowPreset::kFine;
};

struct AlignReport {
  std::size_t aligned = 0;          // frames
  std::size_t tracking_frames = 0;  // key frames not counted
  double median_motion_px = 0;      // over the tracking frames' medians
  double largest_motion_px = 0;
  double residual_before = 0;  // mean over tracking frames, display values
  double residual_after = 0;
};

// For every camera: flow from the key frame to each tracking frame, linear in time between them, and each light's frame warped to the key
// pose. Stored as an "alignment" product a camera: images of role "aligned" (index: step; value: residual of the tracking frames
// around it, in proportion of time) and "flow" (index: tracking step). Throws UsageError for a scan without tracking frames.
AlignReport align_scan(db::Store& store, const db::Scan& scan, const AlignOptions& options);

// Middle of a frame's exposure: the time whose pose the picture shows.
core::Nanoseconds pose_time(const db::Scan& scan, const db::Frame& frame);

// The motion that an alignment found.
align::MotionTrack stored_motion(const db::Store& store, const db::Scan& scan, const db::Product& alignment,
                                 const std::string& camera);

}  // namespace lightstage::cli
