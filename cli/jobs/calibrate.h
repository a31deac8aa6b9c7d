// Calibrating a stage from ball passes in the store.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "db/store.h"

namespace lightstage::cli {

struct CalibrateOptions {
  std::vector<std::string> mirror_balls;  // scans; each camera of each sees the lights once more
  std::optional<std::string>
      grey_ball;  // scan; without one gains stay as the stage's newest calibration has them, 1 if it has none
  double mirror_radius_m = 0.06;
  double grey_radius_m = 0.06;
  double grey_albedo = 0.5;
  std::string name;  // of the calibration; may be empty
};

struct CalibrateReport {
  db::Id calibration_id = 0;
  std::vector<db::CalibratedLight> lights;
  std::size_t placed = 0;
  double median_sigma_degrees = 0;
  bool gains_measured = false;
  std::optional<std::string>
      gains_from;  // without a grey ball: when the calibration that they were taken from was made (UTC)
};

// Directions from the highlights (calib/mirror_ball.h), gains from the grey ball's shading (calib/light_gain.h); stored as a calibration of the
// passes' stage. Uses the stage file's cameras, ball sizes and radius, never the simulator's truth. Throws UsageError when the
// passes stand on different stages or are not of balls.
CalibrateReport calibrate(db::Store& store, const CalibrateOptions& options);

}  // namespace lightstage::cli
