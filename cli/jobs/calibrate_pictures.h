// Lights from loose pictures of balls, without a store.
#pragma once

#include <string>
#include <vector>

#include "calib/mirror_ball.h"
#include "cli/jobs/ball_pictures.h"

namespace lightstage::cli {

struct PlacedLight {
  int index = 0;                       // the picture's place in BallPictures::names, from 0
  bool used = false;                   // its direction stands
  std::string reason;                  // why not; or what was left out of it
  core::Direction direction;           // from the stage's centre
  std::optional<core::Vec3> position;  // metres; from several views by cameras that are known
  double sigma_m = 0;                  // of the position
  double sigma_degrees = 0;
  std::vector<calib::LightEstimate> per_view;  // as BallPictures::views
};

struct PicturesReport {
  std::vector<PlacedLight> lights;
  std::size_t used = 0;
  double median_sigma_degrees = 0;
  // How far the views' own directions lie from the joint one, mean over views and lights that several views placed; NaN for one view.
  double mean_degrees_to_joint = 0;
  double mean_degrees_between = 0;   // of two views' directions of a light
  std::optional<double> rms_px;      // what bundle adjustment leaves of the highlights
  std::vector<calib::Sphere> balls;  // as BallPictures::views, after bundle adjustment where there was one
  double seconds = 0;
};

// Highlights in every view (calib/mirror_ball.h), joined light by light. Where several views disagree by more than their standard errors say,
// all standard errors are raised until they agree (Birge 1932, "The calculation of errors by the method of least squares").
// A light is named "dead" when its pictures hold no more light than the sensor's noise or a hundredth of what the other lights' hold,
// "hidden" when they are lit but no ball shows it.
// Several views by known cameras give positions: calib/light_bundle.h, whose standard errors and reasons then stand.
PicturesReport calibrate_pictures(const BallPictures& pictures);

}  // namespace lightstage::cli
