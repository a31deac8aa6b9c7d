// Calibrating a stage from ball passes in the store.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "cli/jobs/join_lights.h"
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
  std::vector<db::CalibratedLight> lights;  // every light of the stage
  LightsReport joined;                      // as `lights`
  LightSources sources;                     // for cli/report/light_files.h; reads the store
  bool gains_measured = false;
  std::map<int, double> gain_sigma;  // by light index, relative: of gains that were measured
  std::optional<std::string>
      gains_from;  // without a grey ball: when the calibration that they were taken from was made (UTC)
};

// Directions and positions from the highlights of all passes in all cameras (calib/mirror_ball.h, joined by cli/jobs/join_lights.h; every pass is a ball
// of its own, wherever it stood; the distances of the stage file are taken as good to 1 %), gains from the grey ball's shading (calib/light_gain.h);
// stored as a calibration of the passes' stage. Uses the stage file's cameras, ball sizes and distances, never the simulator's truth. A light without
// a highlight is "dead" where the drawing puts one on a ball, else "hidden". Throws UsageError when the passes stand on different stages, are not of
// balls, or one is named twice.
CalibrateReport calibrate(db::Store& store, const CalibrateOptions& options);

}  // namespace lightstage::cli
