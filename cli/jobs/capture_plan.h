// What a `capture` command asks for: the stage, the subject and the sequence, before anything is lit.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "cli/jobs/provenance.h"
#include "db/store.h"

namespace lightstage::cli {

// Cameras of simulated stages take 60 pictures a second; everything else there is as fast as can be.
constexpr core::Nanoseconds kSimulatedPeriod = core::kSecond / 60;

struct CaptureRequest {
  std::filesystem::path stage_file;
  std::filesystem::path sequence_file;  // empty: every light once
  bool mirror_ball = false, grey_ball = false, chessboard = false, white_card = false;
  int board_views = 20;  // of a chessboard: frames under all lights, between which it is moved
  // A tracking frame before every so many lights, 0: none; not given: 10, or as many more as it takes not to flash too often.
  std::optional<int> tracking_every;
  std::vector<double>
      exposure_ms;  // of every light; several are a bracket, whose middle one counts as the usual exposure
  std::optional<capture::Timing> timing;
  std::optional<double> settle_ms;
  bool i_know = false;  // take a sequence that exceeds the limits of the stage's lights

  // Of a simulated stage.
  bool simulate = false;
  std::optional<std::uint64_t> procedural_seed;
  std::filesystem::path mesh;
  double ball_radius_mm = 60;
  double yaw_degrees = 0;
  std::vector<double> at{0, 0, 0};  // metres from stage centre
  int size = 0;
  bool no_noise = false, no_motion = false;
  bool bounce = false;
  std::uint64_t seed = 1;
  std::vector<int> drop;
};

// Reads the files. Throws BadInput for what is wrong with them, UsageError for requests that contradict themselves, and for a sequence that exceeds the
// limits of the stage's lights (capture/light_schedule.h) unless the request says `i_know`. The
// exposures of a real stage's default sequence are whole tenths of a millisecond, which is what V4L2 cameras count in.
CaptureProvenance plan_capture(const CaptureRequest& request);

// As said there, for a plan whose sequence has changed: which limits it exceeds goes into the plan.
void require_within_limits(CaptureProvenance& plan, bool i_know);

// The same for a scan that is gone on with: of the plan's steps those are held against the limits that lack a frame. Whoever is there now is asked again: what
// was stated when the scan was begun (and may be a stranger's word) counts for nothing. What is exceeded is added to the plan; whether anything is.
bool require_rest_within_limits(const db::Store& store, const std::string& name, CaptureProvenance& plan, bool i_know);

// Of what stands on the stage.
db::ScanKind scan_kind(const CaptureRequest& request);

// Throws StoreError unless the store's disk has room for the frames that a pass of that name still lacks, in one line that says how much that is.
void require_room(const db::Store& store, const std::string& name, const CaptureProvenance& plan);

// Adds the scan, without frames. Throws UsageError for a name that exists.
db::Scan begin_scan(db::Store& store, const std::string& name, const CaptureRequest& request,
                    const CaptureProvenance& provenance);

}  // namespace lightstage::cli
