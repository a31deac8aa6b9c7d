#include "calib/board_rig.h"

#include <cmath>
#include <random>

#include "core/direction.h"
#include "sim/held_board.h"
#include "sim/sensor.h"

namespace lightstage::test {

using core::RigidTransform;
using core::Vec3;

std::vector<core::CameraModel> distorted_rig(int cameras, int width, int height, double degrees_apart) {
  std::vector<core::CameraModel> rig;
  for (int c = 0; c < cameras; ++c) {
    const double angle = core::radians_from_degrees(degrees_apart * (c - (cameras - 1) / 2.0));
    core::CameraModel camera =
        core::look_at({std::sin(angle), 0.08 * (c % 3 - 1), std::cos(angle)}, {0, 0.01 * c, 0}, width, height, 34);
    camera.fx *= 1 + 0.004 * c;
    camera.fy *= 1.002 - 0.003 * c;
    camera.cx += 9.0 - 6.5 * c;
    camera.cy += -7.0 + 5.5 * c;
    camera.k1 = -0.22 + 0.05 * c;
    camera.k2 = 0.11 - 0.04 * c;
    camera.p1 = 0.0011 - 0.0007 * c;
    camera.p2 = -0.0008 + 0.0006 * c;
    rig.push_back(camera);
  }
  return rig;
}

sim::Print print_of(const calib::Board& board) {
  constexpr int kPixelsPerSquare = 80, kMargin = 60;
  return {calib::board_picture(board, kPixelsPerSquare, kMargin), board.square_m / kPixelsPerSquare, kMargin};
}

RigidTransform stage_from_board(const calib::Board& board, std::uint64_t seed, int instant, double reach_m) {
  const RigidTransform held = sim::held_board_pose(seed, instant, reach_m);
  const core::Mat3 axes{{Vec3{1, 0, 0}, Vec3{0, -1, 0}, Vec3{0, 0, -1}}};
  const Vec3 corner{-0.5 * board.columns * board.square_m, 0.5 * board.rows * board.square_m, 0};
  return {held.rotation * axes, held.apply(corner)};
}

core::Image picture_of(const core::CameraModel& camera, const calib::Board& board, const RigidTransform& pose,
                       std::uint64_t noise_seed, double blur_px) {
  core::Image radiance = sim::photograph(camera, print_of(board), pose, blur_px);
  for (float& value : radiance.values()) value = 0.03F + 0.75F * value;
  return sim::sense(radiance, {}, 1, core::kSecond, noise_seed);
}

calib::BoardView exact_view(const core::CameraModel& camera, const calib::Board& board, const RigidTransform& pose,
                            double sigma_px, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> error(0, 1);
  calib::BoardView view;
  for (int id = 0; id < board.corner_count(); ++id) {
    const std::optional<core::Pixel> p = camera.project(pose.apply(board.corner(id)));
    if (!p || p->x < 0 || p->y < 0 || p->x > camera.width - 1 || p->y > camera.height - 1) continue;
    const double dx = sigma_px * error(random), dy = sigma_px * error(random);
    view.corners.push_back({id, {p->x + dx, p->y + dy}});
  }
  return view;
}

std::vector<calib::RigCamera> rig_cameras(const std::vector<core::CameraModel>& models) {
  std::vector<calib::RigCamera> cameras;
  for (std::size_t c = 0; c < models.size(); ++c) {
    cameras.push_back({"camera" + std::to_string(c + 1), models[c].width, models[c].height});
  }
  return cameras;
}

}  // namespace lightstage::test
