// Whether a stage's calibration still holds, by a ball pass that it was not made from.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "db/store.h"

namespace lightstage::cli {

// What one camera sees of a light against what the calibration predicts.
struct HighlightResidual {
  int light_index = 0;
  std::string camera;
  bool compared = false;
  std::string reason;           // why not
  double px = 0;                // between the highlight and where calibrated light and ball put it
  double degrees = 0;           // between the light's calibrated direction and the one seen
  double promised_degrees = 0;  // standard error of that difference: the calibration's and this pass's own
};

struct VerifyCalibrationReport {
  db::Id calibration_id = 0;
  std::string calibrated_utc;
  std::vector<HighlightResidual> residuals;
  std::size_t compared = 0;
  double median_px = 0, p95_px = 0, median_degrees = 0, p95_degrees = 0;
  double median_ratio = 0;  // degrees over promised, 0.83 where all is as promised
  std::vector<int> moved;   // lights off by more than kMovedSigmas and kMovedDegrees
  bool recalibrate = false;
  std::string advice;
};

inline constexpr double kMovedSigmas = 5, kMovedDegrees = 0.2;

// Against the newest calibration of the pass's stage. Advises to calibrate again when differences are larger than twice what was promised
// (in the median), or a light has moved. Throws UsageError when the stage has no calibration, or that one was made from this very pass;
// BadInput as calibrate() and when not one highlight can be compared.
VerifyCalibrationReport verify_calibration(const db::Store& store, const std::string& mirror_pass, double radius_m);

}  // namespace lightstage::cli
