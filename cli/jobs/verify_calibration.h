// Whether a stage's calibration still holds, by a ball pass that it was not made from.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "db/store.h"

namespace lightstage::cli {

// What one camera sees of a light against what the calibration predicts.
struct LightResidual {
  int light_index = 0;
  std::string camera;
  bool compared = false;
  std::string reason;           // why not
  double px = 0;                // mirror ball: between the highlight and where calibrated light and ball put it
  double degrees = 0;           // between the light's calibrated direction and the one seen
  double promised_degrees = 0;  // standard error of that difference: the calibration's and this pass's own
  // Grey ball.
  std::array<double, 3> gain_ratio{1, 1, 1};  // of the light's gain in this pass over the calibrated one
  double promised_gain = 0;                   // relative standard error of that: the calibration's and this pass's own
  double shading = 0;                         // root mean square of picture less prediction over the prediction's
};

// A light whose brightness or colour is no longer what was calibrated, the change that all lights share set aside.
struct ChangedLight {
  int light_index = 0;
  std::array<double, 3> gain_ratio{};
  std::string what;  // "is 12 % dimmer", "is dark", "has changed its colour by 8 %"
};

struct VerifyCalibrationReport {
  bool by_grey_ball = false;
  db::Id calibration_id = 0;
  std::string calibrated_utc;
  std::vector<LightResidual> residuals;
  std::size_t compared = 0;
  double median_px = 0, p95_px = 0;  // mirror ball
  double median_degrees = 0, p95_degrees = 0;
  double median_ratio = 0;  // degrees over promised, 0.83 where all is as promised
  std::vector<int>
      moved;  // lights off by more than kMovedSigmas and kMovedDegrees, by the shading kMovedDegreesByShading
  // Grey ball.
  std::array<double, 3> common_gain{1, 1, 1};        // median of the gain ratios
  double median_gain_error = 0, p95_gain_error = 0;  // of single lights from that, the worst channel's
  double median_shading = 0, p95_shading = 0;
  std::vector<ChangedLight> changed;
  bool recalibrate = false;
  std::string advice;
};

inline constexpr double kMovedSigmas = 5, kMovedDegrees = 0.2;
inline constexpr double kMovedDegreesByShading =
    1;  // vignetting that no flat field takes away turns the shading by a few tenths
inline constexpr double kChangedSigmas = 5, kChangedShare = 0.02;

// Against the newest calibration of the pass's stage. A mirror-ball pass is compared by its highlights, in every camera: advises to calibrate again when
// differences are larger than twice what was promised (in the median), or a light has moved. A grey-ball pass by its shading (calib/shading.h), in the first
// camera, with the albedo that the calibration was made with: when single lights have changed by more than kChangedSigmas and kChangedShare, all of
// them together by kChangedShare, or lights have moved. Throws UsageError when the stage has no calibration, that one was made from this very pass, or knows no
// gains; BadInput as calibrate() and when not one light can be compared.
VerifyCalibrationReport verify_calibration(const db::Store& store, const std::string& pass, double radius_m);

}  // namespace lightstage::cli
