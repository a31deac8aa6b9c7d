// What the simulator knows and the pipeline may not: used to judge simulated scans, never to make them.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cli/jobs/provenance.h"
#include "core/direction.h"
#include "core/image.h"
#include "db/scan_loader.h"
#include "db/store.h"
#include "sim/world.h"

namespace lightstage::cli {

class SimulatedTruth {
 public:
  // UsageError for scans that were not captured on the simulated stage.
  SimulatedTruth(const db::Store& store, const std::string& scan_name, const std::string& camera);

  // What the camera would have seen without noise under unit lights in these directions, subject in its key pose.
  std::vector<core::Image> render(std::span<const core::Direction> directions) const;

  struct CalibrationError {
    std::size_t lights = 0;
    double median_degrees = 0, p95_degrees = 0, largest_degrees = 0;
    double median_gain_error = 0;  // relative
  };
  // Of the lights that the scan uses.
  CalibrationError calibration_error(const db::LoadedScan& loaded) const;

  struct AlignmentError {
    std::size_t frames = 0;
    double median_epe_px = 0, p95_epe_px = 0;           // end-point error of the flow of light frames, over the subject
    double psnr_unaligned_db = 0, psnr_aligned_db = 0;  // display values against noise-free truth in the key pose
  };
  // `exposure` is the radiance shown as 1. UsageError when the scan was not aligned.
  AlignmentError alignment_error(const db::Store& store, double exposure) const;

 private:
  core::Nanoseconds key_time(const db::Store& store) const;
  core::Image as_seen(core::ImageView radiance) const;

  db::Scan scan_;
  CaptureProvenance provenance_;
  capture::StageCamera camera_;
  sim::World world_;
  core::Nanoseconds key_time_ = 0;
  db::FlatField flat_;
};

}  // namespace lightstage::cli
