// Cameras with distorted lenses around a board that is held before them, and their pictures.
#pragma once

#include <cstdint>
#include <vector>

#include "calib/camera_calibration.h"
#include "sim/print.h"

namespace lightstage::test {

// Cameras `degrees_apart` degrees apart on an arc of radius 1 m about stage centre, 34 degrees across, with barrel and tangential
// distortion of their own.
std::vector<core::CameraModel> distorted_rig(int cameras, int width, int height, double degrees_apart = 22);

sim::Print print_of(const calib::Board& board);
// Board frame (origin at the top left of its squares) of the pose number `instant`.
core::RigidTransform stage_from_board(const calib::Board& board, std::uint64_t seed, int instant, double reach_m);

// A picture with the noise of a 12-bit sensor.
core::Image picture_of(const core::CameraModel& camera, const calib::Board& board, const core::RigidTransform& pose,
                       std::uint64_t noise_seed, double blur_px = 0.45);

// Corners where geometry puts them, with normal errors of that size, of those that all lie in the picture.
calib::BoardView exact_view(const core::CameraModel& camera, const calib::Board& board,
                            const core::RigidTransform& pose, double sigma_px, std::uint64_t seed);

std::vector<calib::RigCamera> rig_cameras(const std::vector<core::CameraModel>& models);

}  // namespace lightstage::test
