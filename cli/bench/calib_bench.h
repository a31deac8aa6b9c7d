// Calibration on rendered balls against the simulator's truth, and on photographed ones against what is known of their lights.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "calib/light_bundle.h"
#include "cli/bench/simple_spots.h"
#include "sim/world.h"

namespace lightstage::cli {

struct BallStageOptions {
  std::size_t lights = 110;
  int ball_px = 150;       // radius of a ball's image
  std::uint64_t seed = 1;  // of the lights' places and gains, and of noise
};

// A simulated stage: lights all around at 1.2 to 2.5 m, each a degree off its mount and of its own brightness; two cameras with lens
// distortion 1.9 m from the centre, 30 degrees apart; three mirror balls of 60 mm, 0.2 m from each other, of which each camera takes one
// picture a light. The pictures are those parts of the cameras' that show a ball, of one channel.
class BallStage {
 public:
  static constexpr std::size_t kBalls = 3, kCameras = 2;

  explicit BallStage(const BallStageOptions& options);
  ~BallStage();

  const std::vector<core::Light>& true_lights() const;
  const calib::Sphere& true_ball(std::size_t ball) const { return balls_[ball]; }

  // Radiance without noise; rendered once.
  struct View {
    core::CameraModel camera;  // of the part
    core::Image full_on;
    std::vector<core::Image> lights;
  };
  const View& view(std::size_t ball, std::size_t camera) const;

  // Of a grey ball at stage centre as the first camera sees it, three channels.
  View grey_view() const;

  // Through the sensor of 12 bits and 40 dB; `saturation` is the radiance at which it clips.
  core::Image sensed(const core::Image& radiance, double saturation, std::uint64_t seed) const;
  // At which full-on pictures of the mirror balls are taken.
  double full_on_saturation() const;
  static constexpr double kGreyAlbedo = 0.5;
  static constexpr double kGreySaturation = 1 / 0.9;  // a white surface facing a light of unit gain fills nine tenths

  const BallStageOptions& options() const { return options_; }

 private:
  const sim::World& world(std::size_t ball) const;

  BallStageOptions options_;
  std::vector<calib::Sphere> balls_;
  std::vector<core::CameraModel> cameras_;
  mutable std::map<std::size_t, std::unique_ptr<sim::World>> worlds_;
  mutable std::map<std::pair<std::size_t, std::size_t>, View> views_;
};

struct CalibKnobs {
  SpotMethod method = SpotMethod::kFit;
  double clipping = 10;  // the median light's brightest pixel over the value at which the sensor clips
  int balls = 2;         // 1: the middle one, and the lights' distances known to a fifth; 2: the outer ones; 3: all
  int cameras = 1;
};

struct PlacedLights {
  calib::BundleResult bundle;
  double seconds = 0;  // outlines, highlights and bundle adjustment
};
PlacedLights place_lights(const BallStage& stage, const CalibKnobs& knobs);

// What was found on one or several stages against the truth.
struct CalibRow {
  CalibKnobs knobs;
  int ball_px = 0;
  double seconds = 0;
  std::size_t placed = 0, lights = 0;
  double median_degrees = 0, p95_degrees = 0;
  double median_m = 0, p95_m = 0;
  // Root mean square of errors over standard errors, along the axes of each light's covariance: 1 where these are honest.
  double direction_ratio = 0, position_ratio = 0;
};
CalibRow judge(const CalibKnobs& knobs, const std::vector<const BallStage*>& stages,
               const std::vector<PlacedLights>& found);

// Gains of the lights from a grey ball of 60 mm at stage centre in three channels, at 12 bits and 40 dB, without vignetting.
struct GainRow {
  std::size_t measured = 0, lights = 0;
  double median_error = 0, p95_error = 0;  // |gain / truth - 1|, over lights and channels
  double within_1_percent = 0;             // share of them
  double ratio = 0;                        // root mean square of errors over standard errors
};
GainRow measure_gains(const BallStage& stage, const std::vector<calib::BundledLight>& lights);

// Photographs (docs/calibration.md says which). Folders that are not there give no rows.
struct PhotographRow {
  std::string data;     // what was photographed
  std::string outline;  // where the ball's outline was taken from
  SpotMethod method = SpotMethod::kFit;
  std::size_t lights = 0;
  double mean_degrees = 0;  // from the directions known; between the two balls
  double largest_degrees = 0;
  double to_joint_degrees = 0;  // two balls: mean distance from the joint directions
};
std::vector<PhotographRow> photographs(const std::filesystem::path& data);

}  // namespace lightstage::cli
