// Lights seen on one ball or several, by one camera or several: one direction each, and a position where cameras are known.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/ball_circle.h"
#include "calib/light_bundle.h"
#include "calib/mirror_ball.h"
#include "core/image.h"

namespace lightstage::cli {

// A ball as one camera sees it under every light.
struct SeenBall {
  std::string ball;    // views of one name show one ball
  std::string camera;  // empty: nothing is known of it
  core::CameraModel
      model;  // stage frame; parallel rays where nothing is known (calib/ball_circle.h): lengths then in ball radii
  calib::Sphere sphere;

  // "left, front": what reasons call it.
  std::string name() const { return camera.empty() ? ball : ball + ", " + camera; }
};

struct SeenLight {
  int index = 0;
  std::vector<calib::LightEstimate> per_view;  // as the views
  std::string when_unseen;                     // the reason, should no view show a highlight
};

struct JoinOptions {
  bool metric = false;  // cameras and balls are in metres
  // Of the lights from stage centre, where something is known of it.
  std::map<int, calib::LightDistance> distances;
  double largest_sigma_degrees = calib::kLargestSigmaDegrees;  // of lights that are used
};

struct PlacedLight {
  int index = 0;
  bool used = false;                   // its direction stands
  std::string reason;                  // why not; or what was left out of it
  core::Direction direction;           // from the stage's centre
  std::optional<core::Vec3> position;  // metres
  core::Mat3 covariance;               // of the position, square metres, where there is one
  double sigma_m = 0;                  // of the position, all coordinates together
  double sigma_degrees = 0;
  std::vector<calib::LightEstimate> per_view;
};

struct LightsReport {
  std::vector<PlacedLight> lights;  // as they were given
  std::size_t used = 0;
  double median_sigma_degrees = 0;  // NaN for none, as all below
  double median_sigma_m = 0;
  // How far the views' own directions lie from the joint one, mean over views and lights that several views placed.
  double mean_degrees_to_joint = 0;
  double mean_degrees_between = 0;   // of two views' directions of a light
  std::optional<double> rms_px;      // what bundle adjustment leaves of the highlights
  std::vector<calib::Sphere> balls;  // as the views, after bundle adjustment where there was one
};

// What a report of lights was made from.
struct LightSources {
  std::vector<std::string> names;  // of the lights or their pictures, as the report's lights
  std::vector<SeenBall> views;
  std::optional<double> stage_radius_m;
  // The light's picture in that view, 1 where the sensor clips; empty where there is none.
  std::function<core::Image(std::size_t view, std::size_t light)> picture;
};

// Without metric cameras directions are joined light by light; where several views disagree by more than their standard errors say, all
// standard errors are raised until they agree (Birge 1932, "The calculation of errors by the method of least squares"). With them, and several views
// or known distances, by calib/light_bundle.h, whose standard errors and reasons then stand.
LightsReport join_lights(std::span<const SeenBall> views, std::vector<SeenLight> lights, const JoinOptions& options);

}  // namespace lightstage::cli
