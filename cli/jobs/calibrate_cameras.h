// Lenses and poses of cameras from pictures of a board, and where they are kept.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/camera_calibration.h"
#include "cli/jobs/board_pictures.h"
#include "db/store.h"

namespace lightstage::cli {

struct CamerasReport {
  calib::CameraCalibration calibration;  // views as BoardPictures::pictures
  // The frame of the poses: nothing for that of the first camera, else how the rig was placed on the drawn one.
  std::optional<calib::RigPlacement> placement;
  double seconds = 0;
};

// Finds the board in every picture (on all threads) and calibrates. Pictures that cannot be read, or are not of their camera's size, are
// left out with the reason. Where cameras are drawn, the rig is moved to where it is drawn. Throws BadInput as calib::calibrate_cameras, with
// the most frequent reason for pictures without a board.
CamerasReport calibrate_cameras(const BoardPictures& pictures, calib::DistortionTerms terms);

// "none", "k1", "k1,k2", "k1,k2,p1,p2", "k1,k2,k3,p1,p2".
std::string_view to_string(calib::DistortionTerms terms);

// The cameras as entries of a stage file, with the drawn ones' responsivity where there is one.
std::vector<capture::StageCamera> stage_entries(const BoardPictures& pictures, const CamerasReport& report);

// A product of kind "camera_calibration": a calibration of the stage's cameras, which stage_cameras (cli/jobs/stage_cameras.h) then gives.
db::Id store_cameras(db::Store& store, const BoardPictures& pictures, const CamerasReport& report,
                     calib::DistortionTerms terms, const std::string& name);

// cameras.toml ([[camera]] entries as a stage file and `calibrate lights --circles` read them), cameras.json, cameras.png (each
// camera's pictures' corners, and what the calibration leaves of them, enlarged) and, with a stage, stage.toml with these cameras.
void write_camera_files(const std::filesystem::path& folder, const BoardPictures& pictures, const CamerasReport& report,
                        const std::optional<capture::Stage>& stage);

}  // namespace lightstage::cli
