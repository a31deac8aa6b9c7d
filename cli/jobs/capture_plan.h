// What a `capture` command asks for: the stage, the subject and the sequence, before anything is lit.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "cli/jobs/provenance.h"
#include "db/store.h"

namespace lightstage::cli {

struct CaptureRequest {
  std::filesystem::path stage_file;
  std::filesystem::path sequence_file;  // empty: every light once
  bool mirror_ball = false, grey_ball = false, chessboard = false, white_card = false;
  int board_views = 20;  // of a chessboard: frames under all lights, between which it is moved
  int tracking_every = 10;
  std::vector<double>
      exposure_ms;  // of every light; several are a bracket, whose middle one counts as the usual exposure
  std::optional<capture::Timing> timing;
  std::optional<double> settle_ms;

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

// Reads the files. Throws BadInput for what is wrong with them, UsageError for requests that contradict themselves. The
// exposures of a real stage's default sequence are whole tenths of a millisecond, which is what V4L2 cameras count in.
CaptureProvenance plan_capture(const CaptureRequest& request);

// Of what stands on the stage.
db::ScanKind scan_kind(const CaptureRequest& request);

// Adds the scan, without frames. Throws UsageError for a name that exists.
db::Scan begin_scan(db::Store& store, const std::string& name, const CaptureRequest& request,
                    const CaptureProvenance& provenance);

}  // namespace lightstage::cli
