#include "cli/bench/board_bench.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/camera_calibration.h"
#include "core/direction.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/stopwatch.h"
#include "sim/held_board.h"
#include "sim/print.h"
#include "sim/sensor.h"

namespace lightstage::cli {

namespace {

using calib::Board;
using calib::BoardKind;
using calib::CornerMethod;
using calib::DistortionTerms;
using core::CameraModel;
using core::RigidTransform;
using core::Vec3;

constexpr int kMostViews = 32, kUsualViews = 16;
constexpr std::size_t kCameras = 2;

std::vector<CameraModel> true_rig() {
  std::vector<CameraModel> rig;
  for (int c = 0; c < int(kCameras); ++c) {
    CameraModel camera = core::look_at({c == 0 ? -0.2 : 0.2, 0.05, 0.95}, {0, 0, 0}, 640, 480, 34);
    camera.fy *= 1.002;
    camera.cx += 5 - 9.0 * c;
    camera.cy += 7.0 * c - 4;
    camera.k1 = -0.24 + 0.06 * c;
    camera.k2 = 0.13 - 0.05 * c;
    camera.p1 = 0.0010 - 0.0014 * c;
    camera.p2 = -0.0008 + 0.0011 * c;
    rig.push_back(camera);
  }
  return rig;
}

// A board's pictures by every camera at every instant, rendered once.
struct Pictures {
  Board board;
  std::vector<core::Image> images;  // by instant, then camera
};

Pictures shoot(const std::vector<CameraModel>& rig, const Board& board) {
  constexpr int kPixelsPerSquare = 60, kMargin = 45;
  constexpr std::uint64_t kSeed = 77;
  const sim::Print print{calib::board_picture(board, kPixelsPerSquare, kMargin), board.square_m / kPixelsPerSquare,
                         kMargin};
  Pictures pictures{board, {}};
  for (int i = 0; i < kMostViews; ++i) {
    core::throw_if_interrupted();
    const RigidTransform held = sim::held_board_pose(kSeed, i, 0.1);
    const core::Mat3 axes{{Vec3{1, 0, 0}, Vec3{0, -1, 0}, Vec3{0, 0, -1}}};
    const RigidTransform pose{held.rotation * axes, held.apply({-0.5 * board.columns * board.square_m,
                                                                0.5 * board.rows * board.square_m, 0})};
    for (std::size_t c = 0; c < kCameras; ++c) {
      core::Image radiance = sim::photograph(rig[c], print, pose);
      for (float& value : radiance.values()) value = 0.03F + 0.75F * value;
      pictures.images.push_back(sim::sense(radiance, {}, 1, core::kSecond, std::uint64_t(i) * kCameras + c));
    }
  }
  return pictures;
}

const char* name_of(CornerMethod method) {
  switch (method) {
    case CornerMethod::kClassic:
      return "classic";
    case CornerMethod::kSectors:
      return "sectors";
    case CornerMethod::kEither:
      break;
  }
  return "either";
}

const char* name_of(DistortionTerms terms) {
  switch (terms) {
    case DistortionTerms::kNone:
      return "none";
    case DistortionTerms::kK1:
      return "k1";
    case DistortionTerms::kK1K2:
      return "k1,k2";
    case DistortionTerms::kK1K2P1P2:
      return "k1,k2,p1,p2";
    case DistortionTerms::kAll:
      break;
  }
  return "k1,k2,k3,p1,p2";
}

double undistorted_px(const CameraModel& found, const CameraModel& truth) {
  constexpr int kStep = 8;
  double square = 0;
  int count = 0;
  for (int y = 0; y < truth.height; y += kStep) {
    for (int x = 0; x < truth.width; x += kStep, ++count) {
      const Vec3 a = found.ray_in_camera({double(x), double(y)}), b = truth.ray_in_camera({double(x), double(y)});
      square += std::pow(found.fx * a.x / a.z + found.cx - truth.fx * b.x / b.z - truth.cx, 2) +
                std::pow(found.fy * a.y / a.z + found.cy - truth.fy * b.y / b.z - truth.cy, 2);
    }
  }
  return std::sqrt(square / count);
}

void judge(BoardBenchRow& row, const calib::CameraCalibration& result, const std::vector<CameraModel>& rig) {
  for (std::size_t c = 0; c < kCameras; ++c) {
    const CameraModel &found = result.cameras[c].model, &truth = rig[c];
    row.focal_percent =
        std::max({row.focal_percent, 100 * std::abs(found.fx / truth.fx - 1), 100 * std::abs(found.fy / truth.fy - 1)});
    row.principal_px = std::max(row.principal_px, std::hypot(found.cx - truth.cx, found.cy - truth.cy));
    row.undistorted_px = std::max(row.undistorted_px, undistorted_px(found, truth));
  }
  const RigidTransform first = rig[0].stage_from_camera.inverse(), &found = result.cameras[1].model.stage_from_camera;
  row.position_mm = 1000 * norm(found.translation - first.apply(rig[1].centre()));
  const core::Mat3 turn = found.rotation.transposed() * (first.rotation * rig[1].stage_from_camera.rotation);
  const double sine = 0.5 * core::norm({turn.rows[2].y - turn.rows[1].z, turn.rows[0].z - turn.rows[2].x,
                                        turn.rows[1].x - turn.rows[0].y});
  row.rotation_degrees = core::degrees_from_radians(std::asin(std::min(1.0, sine)));
}

BoardBenchRow measure(const std::vector<CameraModel>& rig, const Pictures& pictures, int views, CornerMethod method,
                      DistortionTerms terms) {
  BoardBenchRow row{.views = views,
                    .corners = pictures.board.kind == BoardKind::kCharuco ? "charuco" : name_of(method),
                    .distortion = name_of(terms)};
  const core::Stopwatch watch;
  calib::CameraCalibrationInput input{.board = pictures.board, .distortion = terms};
  for (std::size_t c = 0; c < kCameras; ++c) {
    input.cameras.push_back({"camera" + std::to_string(c + 1), rig[c].width, rig[c].height});
  }
  for (int i = 0; i < views; ++i) {
    for (std::size_t c = 0; c < kCameras; ++c) {
      core::throw_if_interrupted();
      const core::Image& picture = pictures.images[std::size_t(i) * kCameras + c];
      input.views.push_back({c, std::size_t(i), calib::find_board(picture, pictures.board, method).corners});
    }
  }
  try {
    const calib::CameraCalibration result = calib::calibrate_cameras(input);
    row.seconds = watch.seconds();
    judge(row, result, rig);
  } catch (const core::BadInput& error) {
    row.seconds = watch.seconds();
    row.refused = error.what();
    row.undistorted_px = row.focal_percent = row.principal_px = row.position_mm = row.rotation_degrees =
        std::numeric_limits<double>::quiet_NaN();
  }
  return row;
}

}  // namespace

std::vector<BoardBenchRow> bench_boards() {
  const std::vector<CameraModel> rig = true_rig();
  const Pictures chessboard = shoot(rig, {.kind = BoardKind::kChessboard, .columns = 10, .rows = 7, .square_m = 0.03});
  const Pictures charuco = shoot(rig, {.columns = 10, .rows = 7, .square_m = 0.036, .marker_m = 0.022});
  std::vector<BoardBenchRow> rows;
  constexpr CornerMethod kMethod = CornerMethod::kEither;
  constexpr DistortionTerms kTerms = DistortionTerms::kK1K2P1P2;
  core::Progress progress("cameras from boards", 14);
  const auto add = [&](const Pictures& pictures, int views, CornerMethod method, DistortionTerms terms) {
    rows.push_back(measure(rig, pictures, views, method, terms));
    progress.advance();
  };
  for (const int views : {4, 8, kUsualViews, kMostViews}) {
    add(chessboard, views, kMethod, kTerms);
    add(charuco, views, kMethod, kTerms);
  }
  add(chessboard, kUsualViews, CornerMethod::kClassic, kTerms);
  add(chessboard, kUsualViews, CornerMethod::kSectors, kTerms);
  for (const DistortionTerms terms :
       {DistortionTerms::kNone, DistortionTerms::kK1, DistortionTerms::kK1K2, DistortionTerms::kAll}) {
    add(charuco, kUsualViews, kMethod, terms);
  }
  return rows;
}

}  // namespace lightstage::cli
