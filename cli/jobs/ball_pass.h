// Passes of calibration balls in the store.
#pragma once

#include <string>
#include <vector>

#include "calib/mirror_ball.h"
#include "calib/sphere_fit.h"
#include "capture/stage.h"
#include "db/store.h"

namespace lightstage::cli {

// The scan of this name. UsageError when it is of another kind: `what` says what it should show.
db::Scan ball_pass(const db::Store& store, const std::string& name, db::ScanKind kind, const char* what);

// One camera's frames of a ball pass, and where the ball is in them.
struct BallView {
  core::CameraModel camera;
  core::Image dark, flat;  // as db::load_frame takes them
  calib::Sphere ball;
  std::vector<db::Frame> light_frames;
  std::vector<int> light_index;  // per light frame
};

// Finds the ball in the pass's full-on frame. Throws BadInput naming scan and camera when there is none, it is overexposed, or shows no ball.
BallView view_ball(const db::Store& store, const db::Scan& scan, const capture::StageCamera& camera, double radius_m);

// The picture of a light, as the view's i-th frame has it.
calib::BallPicture picture_of_light(const db::Store& store, const BallView& view, std::size_t i);

}  // namespace lightstage::cli
