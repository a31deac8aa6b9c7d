#include "cli/jobs/ball_pass.h"

#include "core/error.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

// A clipped edge lies outside the true one: such a frame would give too large a ball.
void require_not_overexposed(core::ImageView full_on, double saturation, const std::string& where) {
  if (saturation <= 0) return;
  std::size_t bright = 0, clipped = 0;
  const core::Image luminance = core::to_luminance(full_on);
  for (const float value : luminance.values()) {
    if (value > 0.1 * saturation) ++bright;
    if (value > 0.98 * saturation) ++clipped;
  }
  if (clipped * 2 > bright) {
    throw core::BadInput(where +
                         ": overexposed, so that the ball's outline cannot be told; shorten that step's exposure, or "
                         "take larger pictures");
  }
}

}  // namespace

db::Scan ball_pass(const db::Store& store, const std::string& name, db::ScanKind kind, const char* what) {
  db::Scan scan = store.scan(name);
  if (scan.kind != kind) {
    throw core::UsageError("scan '" + name + "' is " + std::string(db::to_string(scan.kind)) + ", not a pass of a " +
                           what);
  }
  return scan;
}

BallView view_ball(const db::Store& store, const db::Scan& scan, const capture::StageCamera& camera, double radius_m) {
  BallView view;
  view.camera = camera.model;
  view.dark = db::dark_level(store, scan, camera.name);
  view.flat = db::flat_field(store, scan, camera.name).image;
  const std::string where = "scan '" + scan.name + "', camera '" + camera.name + "', full-on frame";
  std::optional<core::Image> full_on;
  for (const db::Frame& frame : store.frames(scan.id, camera.name)) {
    const db::Step& step = db::step_of(scan, frame.step_index);
    if (step.kind == db::StepKind::kFullOn) {
      full_on = db::load_frame(store, frame, view.dark, view.flat);
      require_not_overexposed(*full_on, frame.saturation, where);
    }
    if (step.kind == db::StepKind::kLight) {
      view.light_frames.push_back(frame);
      view.light_index.push_back(*step.light_index);
    }
  }
  if (!full_on) {
    throw core::BadInput(where + ": missing; the ball is found in it, capture the pass with a full_on step");
  }
  try {
    view.ball = calib::locate_sphere(*full_on, camera.model, radius_m);
  } catch (const core::BadInput& error) {
    throw core::BadInput(where + ": " + error.what());
  }
  return view;
}

calib::BallPicture picture_of_light(const db::Store& store, const BallView& view, std::size_t i) {
  const db::Frame& frame = view.light_frames[i];
  return {view.light_index[i], db::load_frame(store, frame, view.dark, view.flat), frame.saturation};
}

}  // namespace lightstage::cli
