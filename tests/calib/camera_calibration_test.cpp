// Lenses and poses of cameras from views of a board.
#include <catch2/catch.hpp>

#include <iostream>
#include <random>

#include "calib/board_rig.h"
#include "core/direction.h"
#include "core/error.h"
#include "core/stopwatch.h"
#include "core/undistortion.h"

namespace lightstage::calib {

namespace {

using core::CameraModel;
using core::RigidTransform;

const Board kChessboard{.kind = BoardKind::kChessboard, .columns = 10, .rows = 7, .square_m = 0.028};
const Board kEven{.kind = BoardKind::kChessboard, .columns = 9, .rows = 7, .square_m = 0.03};
const Board kCharuco{.kind = BoardKind::kCharuco, .columns = 10, .rows = 7, .square_m = 0.028, .marker_m = 0.018};

RigidTransform compose(const RigidTransform& a, const RigidTransform& b) {
  return {a.rotation * b.rotation, a.apply(b.translation)};
}

double degrees_between(const core::Mat3& a, const core::Mat3& b) {
  const core::Mat3 r = a.transposed() * b;
  return core::degrees_from_radians(
      std::acos(std::clamp((r.rows[0].x + r.rows[1].y + r.rows[2].z - 1) / 2, -1.0, 1.0)));
}

// The true pose in the frame of the rig's first camera.
RigidTransform true_pose(const std::vector<CameraModel>& rig, std::size_t c) {
  return compose(rig[0].stage_from_camera.inverse(), rig[c].stage_from_camera);
}

// By how much a point that the true lens puts at a pixel is put elsewhere by undistorting it, at most over the picture as far as
// corners were seen; after the best change of focal length and principal point by the plane's own scale: in true undistorted pixels.
double largest_undistortion_error_px(const CameraModel& found, const CameraModel& truth, double reach) {
  double largest = 0;
  const double farthest = std::hypot(truth.cx, truth.cy);
  for (int y = 0; y < truth.height; y += 20) {
    for (int x = 0; x < truth.width; x += 20) {
      if (std::hypot(x - truth.cx, y - truth.cy) > reach * farthest) continue;
      const core::Vec3 a = found.ray_in_camera({double(x), double(y)}), b = truth.ray_in_camera({double(x), double(y)});
      largest = std::max(largest, std::hypot(found.fx * a.x / a.z + found.cx - truth.fx * b.x / b.z - truth.cx,
                                             found.fy * a.y / a.z + found.cy - truth.fy * b.y / b.z - truth.cy));
    }
  }
  return largest;
}

CameraCalibrationInput exact_input(const std::vector<CameraModel>& rig, const Board& board, int instants,
                                   double sigma_px, std::uint64_t seed) {
  CameraCalibrationInput input{.board = board, .cameras = test::rig_cameras(rig)};
  for (int i = 0; i < instants; ++i) {
    for (std::size_t c = 0; c < rig.size(); ++c) {
      BoardView view = test::exact_view(rig[c], board, test::stage_from_board(board, 11, i, 0.12), sigma_px,
                                        seed * 1000 + std::uint64_t(i) * 20 + c);
      view.camera = c;
      view.instant = std::size_t(i);
      if (board.kind == BoardKind::kChessboard && int(view.corners.size()) < board.corner_count()) view.corners.clear();
      input.views.push_back(view);
    }
  }
  return input;
}

std::string refusal(const CameraCalibrationInput& input) {
  try {
    calibrate_cameras(input);
  } catch (const core::BadInput& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("corners without errors give the cameras back exactly") {
  const std::vector<CameraModel> rig = test::distorted_rig(3, 900, 700);
  for (const Board& board : {kChessboard, kEven, kCharuco}) {
    CameraCalibrationInput input = exact_input(rig, board, 14, 0, 1);
    if (board.looks_same_upside_down()) {
      // The second camera takes every third view for the other end up.
      for (BoardView& view : input.views) {
        if (view.camera != 1 || view.instant % 3 != 1 || view.corners.empty()) continue;
        for (BoardCorner& corner : view.corners) corner.id = board.corner_count() - 1 - corner.id;
      }
    }
    const CameraCalibration result = calibrate_cameras(input);
    CHECK(result.rms_px < 1e-5);
    for (std::size_t c = 0; c < rig.size(); ++c) {
      const CameraModel& found = result.cameras[c].model;
      INFO("camera " << c);
      CHECK(found.fx == Approx(rig[c].fx).epsilon(1e-6));
      CHECK(found.fy == Approx(rig[c].fy).epsilon(1e-6));
      CHECK(found.cx == Approx(rig[c].cx).margin(1e-3));
      CHECK(found.cy == Approx(rig[c].cy).margin(1e-3));
      CHECK(found.k1 == Approx(rig[c].k1).margin(1e-5));
      CHECK(found.k2 == Approx(rig[c].k2).margin(1e-4));
      CHECK(found.p1 == Approx(rig[c].p1).margin(1e-6));
      CHECK(found.p2 == Approx(rig[c].p2).margin(1e-6));
      const RigidTransform truth = true_pose(rig, c);
      CHECK(norm(found.centre() - truth.translation) < 1e-5);
      CHECK(degrees_between(found.stage_from_camera.rotation, truth.rotation) < 1e-3);
    }
  }
}

TEST_CASE("three rendered cameras with distortion are calibrated from two dozen views of a board") {
  const std::vector<CameraModel> rig = test::distorted_rig(3, 900, 700);
  const Board chessboard{.kind = BoardKind::kChessboard, .columns = 12, .rows = 9, .square_m = 0.03};
  const Board charuco{.columns = 12, .rows = 9, .square_m = 0.036, .marker_m = 0.022};
  for (const Board& board : {chessboard, charuco}) {
    const int instants = board.kind == BoardKind::kCharuco ? 24 : 14;
    CameraCalibrationInput input{.board = board, .cameras = test::rig_cameras(rig)};
    for (int i = 0; i < instants; ++i) {
      const RigidTransform pose = test::stage_from_board(board, 5, i, 0.11);
      for (std::size_t c = 0; c < rig.size(); ++c) {
        const BoardSeen seen = find_board(test::picture_of(rig[c], board, pose, std::uint64_t(i) * 7 + c), board);
        input.views.push_back({c, std::size_t(i), seen.corners});
      }
    }
    const core::Stopwatch watch;
    const CameraCalibration result = calibrate_cameras(input);
    const double seconds = watch.seconds();
    for (std::size_t c = 0; c < rig.size(); ++c) {
      const CalibratedCamera& camera = result.cameras[c];
      const CameraModel& found = camera.model;
      const RigidTransform truth = true_pose(rig, c);
      const double focal = std::max(std::abs(found.fx / rig[c].fx - 1), std::abs(found.fy / rig[c].fy - 1));
      const double principal = std::hypot(found.cx - rig[c].cx, found.cy - rig[c].cy);
      const double undistorted = largest_undistortion_error_px(found, rig[c], camera.reach);
      const double place_mm = 1000 * norm(found.centre() - truth.translation);
      const double turn = degrees_between(found.stage_from_camera.rotation, truth.rotation);
      std::cout << "camera " << c << ": " << camera.views << " views, corners to " << camera.sigma_px << " px, reach "
                << camera.reach << "; focal length off by " << 100 * focal << " %, principal point " << principal
                << " px, undistorted positions " << undistorted << " px, place " << place_mm << " mm, turn " << turn
                << " degrees; " << seconds << " s\n";
      CHECK(focal < 0.001);
      CHECK(principal < 1);
      CHECK(undistorted < 0.1);
      CHECK(place_mm < 0.5);
      CHECK(turn < 0.02);
      for (const std::string& warning : camera.warnings) INFO(warning);
      CHECK(camera.warnings.empty());
    }
  }
}

TEST_CASE("standard errors of cameras are as large as their errors") {
  const std::vector<CameraModel> rig = test::distorted_rig(2, 900, 700);
  constexpr double kSigma = 0.08;
  std::vector<double> normalised;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const CameraCalibration result = calibrate_cameras(exact_input(rig, kCharuco, 10, kSigma, seed));
    for (std::size_t c = 0; c < 2; ++c) {
      const CalibratedCamera& camera = result.cameras[c];
      const CameraModel &found = camera.model, &truth = rig[c];
      CHECK(camera.sigma_px == Approx(kSigma).epsilon(0.1));
      const auto add = [&](double error, double sigma) {
        REQUIRE(sigma > 0);
        normalised.push_back(error / sigma);
      };
      add(found.fx - truth.fx, camera.sigma.fx);
      add(found.fy - truth.fy, camera.sigma.fy);
      add(found.cx - truth.cx, camera.sigma.cx);
      add(found.cy - truth.cy, camera.sigma.cy);
      add(found.k1 - truth.k1, camera.sigma.k1);
      add(found.k2 - truth.k2, camera.sigma.k2);
      add(found.p1 - truth.p1, camera.sigma.p1);
      add(found.p2 - truth.p2, camera.sigma.p2);
      CHECK(camera.sigma.k3 == 0);
      if (c == 0) continue;
      const RigidTransform pose = true_pose(rig, c);
      const core::Vec3 off = found.centre() - pose.translation;
      add(off.x, camera.sigma.position.x);
      add(off.y, camera.sigma.position.y);
      add(off.z, camera.sigma.position.z);
      const core::Mat3 turn = pose.rotation.transposed() * found.stage_from_camera.rotation;
      add((turn.rows[2].y - turn.rows[1].z) / 2, camera.sigma.rotation.x);
      add((turn.rows[0].z - turn.rows[2].x) / 2, camera.sigma.rotation.y);
      add((turn.rows[1].x - turn.rows[0].y) / 2, camera.sigma.rotation.z);
    }
  }
  double square = 0;
  for (const double n : normalised) square += n * n / double(normalised.size());
  std::cout << "errors over standard errors, root mean square: " << std::sqrt(square) << " of " << normalised.size()
            << "\n";
  CHECK(std::sqrt(square) > 0.85);
  CHECK(std::sqrt(square) < 1.15);
}

TEST_CASE("views that do not fit are named and left out, and so are single corners") {
  const std::vector<CameraModel> rig = test::distorted_rig(2, 900, 700);
  CameraCalibrationInput input = exact_input(rig, kCharuco, 16, 0.05, 3);
  // The board moved before the second camera's fourth picture; one corner of another was taken for its neighbour.
  const std::size_t moved = 2 * 3 + 1, confused = 2 * 8;
  RigidTransform pose = test::stage_from_board(kCharuco, 11, 3, 0.12);
  pose.translation.x += 0.01;
  input.views[moved].corners = test::exact_view(rig[1], kCharuco, pose, 0.05, 9).corners;
  input.views[confused].corners[5].position.x += 9;
  const CameraCalibration result = calibrate_cameras(input);
  // Which of the two pictures of an instant is wrong nothing tells.
  CHECK((!result.views[moved].used || !result.views[moved - 1].used));
  const CalibratedView& named = result.views[moved].used ? result.views[moved - 1] : result.views[moved];
  CHECK(named.reason.find("moved between") != std::string::npos);
  CHECK(result.views[confused].used);
  CHECK(result.views[confused].reason.find("without 1 corner") != std::string::npos);
  for (std::size_t c = 0; c < 2; ++c) {
    CHECK(result.cameras[c].model.fx == Approx(rig[c].fx).epsilon(1e-3));
    CHECK(norm(result.cameras[c].model.centre() - true_pose(rig, c).translation) < 5e-4);
  }
  CHECK(result.rms_px < 0.09);
}

TEST_CASE("sets of views that cannot determine cameras are refused with advice") {
  const std::vector<CameraModel> rig = test::distorted_rig(2, 900, 700);
  CameraCalibrationInput input = exact_input(rig, kChessboard, 12, 0.05, 4);
  const auto with = [&](auto&& keep) {
    CameraCalibrationInput some = input;
    std::erase_if(some.views, [&](const BoardView& view) { return !keep(view); });
    return refusal(some);
  };
  CHECK(with([](const BoardView&) { return false; }).find("10 to 20 pictures") != std::string::npos);
  CHECK(with([](const BoardView& view) { return view.instant == 0; }).find("at least 3") != std::string::npos);
  // Each camera has views enough, but never one together with the other.
  const std::string apart = with([](const BoardView& view) { return (view.instant % 2 == 0) == (view.camera == 0); });
  CHECK(apart.find("at the same time") != std::string::npos);

  // Held parallel to the picture at every distance.
  for (const double tilt : {0.0, 25.0}) {
    CameraCalibrationInput parallel{.board = kChessboard, .cameras = {test::rig_cameras(rig)[0]}};
    for (std::size_t i = 0; i < 10; ++i) {
      RigidTransform pose = rig[0].stage_from_camera;
      pose.rotation = pose.rotation * core::rotation_about({1, 0.3, 0}, core::radians_from_degrees(tilt));
      pose.translation = rig[0].stage_from_camera.apply({-0.14 + 0.01 * double(i), -0.1, 0.9 + 0.02 * double(i)});
      BoardView view = test::exact_view(rig[0], kChessboard, pose, 0.05, i);
      view.instant = i;
      parallel.views.push_back(view);
    }
    INFO("tilted by " << tilt << " degrees: " << refusal(parallel));
    CHECK(refusal(parallel).find("tilted by 20 to 45 degrees") != std::string::npos);
  }

  // A board of a few millimetres.
  Board tiny = kChessboard;
  tiny.square_m = 0.0015;
  const std::string small = refusal(exact_input({rig[0]}, tiny, 8, 0.2, 5));
  INFO(small);
  CHECK(!small.empty());

  // Seen together once, a board that looks the same upside down leaves two places for the second camera; another one does not.
  for (const Board& board : {kEven, kChessboard}) {
    CameraCalibrationInput once = exact_input(rig, board, 9, 0, 4);
    std::erase_if(once.views,
                  [](const BoardView& view) { return view.instant != 4 && (view.instant < 4) != (view.camera == 0); });
    INFO(refusal(once));
    CHECK((refusal(once).find("which end is up") != std::string::npos) == board.looks_same_upside_down());
  }

  CHECK(refusal({.board = kChessboard, .cameras = {}}).find("no cameras") != std::string::npos);
  BoardView wrong = input.views[0];
  wrong.corners[0].id = 1000;
  CHECK(refusal({.board = kChessboard, .cameras = input.cameras, .views = {wrong}}).find("does not have") !=
        std::string::npos);
}

TEST_CASE("few views, and views of the picture's middle alone, are said to be weak") {
  const std::vector<CameraModel> rig = test::distorted_rig(1, 900, 700);
  Board small = kCharuco;
  small.square_m = 0.012;
  small.marker_m = 0.008;
  CameraCalibrationInput input{.board = small, .cameras = test::rig_cameras(rig)};
  for (int i = 0; i < 6; ++i) {
    BoardView view =
        test::exact_view(rig[0], small, test::stage_from_board(small, 11, i, 0.02), 0.05, std::uint64_t(i));
    view.instant = std::size_t(i);
    input.views.push_back(view);
  }
  const CameraCalibration result = calibrate_cameras(input);
  std::string warnings;
  for (const std::string& warning : result.cameras[0].warnings) warnings += warning + "\n";
  INFO(warnings);
  CHECK(warnings.find("only 6 pictures") != std::string::npos);
  CHECK(warnings.find("extrapolated") != std::string::npos);
}

TEST_CASE("a rig is placed where it was drawn, as nearly as a rigid motion can") {
  const std::vector<CameraModel> rig = test::distorted_rig(3, 900, 700);
  CameraCalibration result = calibrate_cameras(exact_input(rig, kCharuco, 12, 0, 6));
  const core::Mat3 before = result.cameras[2].position_covariance;
  const RigPlacement placement = place_rig(result, rig);
  CHECK(placement.position_rms_m < 1e-5);
  CHECK(placement.rotation_rms_degrees < 1e-3);
  CHECK(placement.drawn_over_found == Approx(1).margin(1e-4));
  for (std::size_t c = 0; c < 3; ++c) {
    CHECK(norm(result.cameras[c].model.centre() - rig[c].centre()) < 1e-5);
    CHECK(degrees_between(result.cameras[c].model.stage_from_camera.rotation, rig[c].stage_from_camera.rotation) <
          1e-3);
  }
  const core::RigidTransform board = test::stage_from_board(kCharuco, 11, 4, 0.12);
  REQUIRE(result.rig_from_board[4]);
  CHECK(norm(result.rig_from_board[4]->apply(kCharuco.corner(20)) - board.apply(kCharuco.corner(20))) < 1e-5);
  const auto trace = [](const core::Mat3& m) { return m.rows[0].x + m.rows[1].y + m.rows[2].z; };
  CHECK(trace(result.cameras[2].position_covariance) == Approx(trace(before)));

  // One camera alone takes the drawn pose; a board said to be twice as large shows.
  CameraCalibration one = calibrate_cameras(exact_input({rig[1]}, kCharuco, 12, 0, 6));
  CHECK(place_rig(one, {rig[1]}).position_rms_m < 1e-9);
  Board doubled = kCharuco;
  doubled.square_m *= 2;
  CameraCalibrationInput input = exact_input(rig, kCharuco, 12, 0, 6);
  input.board = doubled;
  CameraCalibration large = calibrate_cameras(input);
  CHECK(place_rig(large, rig).drawn_over_found == Approx(0.5).margin(1e-3));
  CHECK_THROWS_AS(place_rig(large, {rig[0]}), core::BadInput);
}

}  // namespace lightstage::calib
