// Aligning a captured scan to the pose of its key frame.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "align/flow.h"
#include "align/motion_track.h"
#include "db/store.h"

namespace lightstage::cli {

struct AlignOptions {
  align::FlowPreset preset = align::FlowPreset::kFine;
  int shrink = 1;  // flow of pictures so many times smaller
  align::Between between = align::Between::kCatmullRom;
};

// A frame that no other step of the work is to use.
struct ExcludedFrame {
  std::string camera;
  int step_index = 0;
  std::optional<int> light_index = {};  // nothing for a tracking frame
  std::string reason;
};

struct AlignReport {
  std::size_t aligned = 0;          // frames
  std::size_t tracking_frames = 0;  // key frames not counted
  double median_motion_px = 0;      // over the tracking frames' medians
  double largest_motion_px = 0;
  double residual_before = 0;  // mean over tracking frames, display values
  double residual_after = 0;
  double believed = 0;  // share of the subject where flow there and back agree, mean over tracking frames
  std::vector<ExcludedFrame> excluded;  // in order of camera and time
  double masked = 0;                    // share of the subject that some frame that is used does not show
  std::set<int> lost_lights;            // of which some camera has no frame that is used
};

// For every camera: flow from the key frame to each tracking frame and back, in between as `between` says, and each light's frame warped to
// the key pose. Tracking frames that do not agree with the key frame (align/agreement.h) are left out, and the frames next to them are
// not to be used. Stored as an "alignment" product a camera: images of role "aligned" (index: step; value: residual of the tracking frames
// around it, in proportion of time), "excluded" in their place for those not to be used, "confidence" (index: step of the aligned frame; one
// channel, 0 where the frame does not show the place), "flow" and "flow_confidence" (index: tracking step; value: residual), and "seen" (0
// where a frame that is used does not show the subject: loaded scans add it to their mask); its parameters list the excluded with reasons. Takes memory
// for as many pictures as there are threads (fewer where they are large), however long the pass. Throws UsageError for a scan without
// tracking frames, and BadInput when the frames of more than half of a camera's lights could not be used.
AlignReport align_scan(db::Store& store, const db::Scan& scan, const AlignOptions& options);

// Throws StoreError where the disk has too little room for the pictures that aligning or registering the scan stores.
void require_room_for_alignment(const db::Store& store, const db::Scan& scan);

// Middle of a frame's exposure: the time whose pose the picture shows.
core::Nanoseconds pose_time(const db::Scan& scan, const db::Frame& frame);

// The motion that an alignment found.
align::MotionTrack stored_motion(const db::Store& store, const db::Scan& scan, const db::Product& alignment,
                                 const std::string& camera);

}  // namespace lightstage::cli
