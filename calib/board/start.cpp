#include "calib/board/start.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <opencv2/calib3d.hpp>

#include "core/error.h"

namespace lightstage::calib {

using core::RigidTransform;

std::optional<double> focal_from_homographies(const Board& board, const RigCamera& camera,
                                              const std::vector<const BoardView*>& views) {
  const double middle_x = (camera.width - 1) / 2.0, middle_y = (camera.height - 1) / 2.0;
  const double unit = std::max(camera.width, camera.height);
  double left = 0, right = 0;  // left / focal^2 = right, in units of `unit`
  for (const BoardView* view : views) {
    std::vector<cv::Point2d> from, to;
    for (const BoardCorner& corner : view->corners) {
      const core::Vec3 p = board.corner(corner.id) / board.square_m;
      from.emplace_back(p.x, p.y);
      to.emplace_back((corner.position.x - middle_x) / unit, (corner.position.y - middle_y) / unit);
    }
    const cv::Mat found = cv::findHomography(from, to);
    if (found.empty()) continue;
    cv::Matx33d h(found);
    // A homography's scale is free: that of its first two columns, so that large and small boards count alike.
    const double size = std::hypot(std::hypot(h(0, 0), h(1, 0)), std::hypot(h(0, 1), h(1, 1)));
    if (!(size > 0)) continue;
    h *= 1 / size;
    const auto add = [&](double plane, double depth) {  // plane / focal^2 + depth = 0
      left += plane * plane;
      right -= plane * depth;
    };
    add(h(0, 0) * h(0, 1) + h(1, 0) * h(1, 1), h(2, 0) * h(2, 1));
    add((h(0, 0) * h(0, 0) + h(1, 0) * h(1, 0) - h(0, 1) * h(0, 1) - h(1, 1) * h(1, 1)),
        h(2, 0) * h(2, 0) - h(2, 1) * h(2, 1));
  }
  if (!(right > 0) || !(left > 0)) return std::nullopt;
  const double focal = std::sqrt(left / right) * unit;
  constexpr double kShortest = 0.3, kLongest = 50;
  if (!(focal > kShortest * unit && focal < kLongest * unit)) return std::nullopt;
  return focal;
}

std::optional<RigidTransform> board_pose(const Board& board, const core::CameraModel& lens,
                                         const std::vector<BoardCorner>& corners) {
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  for (const BoardCorner& corner : corners) {
    core::Vec3 ray{(corner.position.x - lens.cx) / lens.fx, (corner.position.y - lens.cy) / lens.fy, 1};
    try {
      ray = lens.ray_in_camera(corner.position);
    } catch (const core::BadInput&) {
      // A lens that is still being looked for may fold there; the undistorted place will do to start from.
    }
    const core::Vec3 p = board.corner(corner.id);
    object.emplace_back(p.x, p.y, p.z);
    image.emplace_back(ray.x / ray.z, ray.y / ray.z);
  }
  const cv::Matx33d none = cv::Matx33d::eye();
  std::vector<cv::Mat> turns, shifts;
  cv::solvePnPGeneric(object, image, none, cv::noArray(), turns, shifts, false, cv::SOLVEPNP_IPPE);
  std::optional<RigidTransform> best;
  double best_error = 0;
  for (std::size_t i = 0; i < turns.size(); ++i) {
    cv::solvePnPRefineLM(object, image, none, cv::noArray(), turns[i], shifts[i]);
    std::vector<cv::Point2d> predicted;
    cv::projectPoints(object, turns[i], shifts[i], none, cv::noArray(), predicted);
    const double error = cv::norm(predicted, image);
    cv::Matx33d r;
    cv::Rodrigues(turns[i], r);
    const cv::Vec3d t(shifts[i]);
    if (!(t[2] > 0) || !std::isfinite(error) || (best && error >= best_error)) continue;
    best_error = error;
    best = RigidTransform{core::Mat3{{core::Vec3{r(0, 0), r(0, 1), r(0, 2)}, core::Vec3{r(1, 0), r(1, 1), r(1, 2)},
                                      core::Vec3{r(2, 0), r(2, 1), r(2, 2)}}},
                          {t[0], t[1], t[2]}};
  }
  return best;
}

RigidTransform half_turn(const Board& board) {
  return {core::Mat3{{core::Vec3{-1, 0, 0}, core::Vec3{0, -1, 0}, core::Vec3{0, 0, 1}}},
          {board.square_m * board.columns, board.square_m * board.rows, 0}};
}

void turn_upside_down(const Board& board, std::vector<BoardCorner>& corners) {
  for (BoardCorner& corner : corners) corner.id = board.corner_count() - 1 - corner.id;
  std::reverse(corners.begin(), corners.end());
}

RigidTransform operator*(const RigidTransform& outer, const RigidTransform& inner) {
  return {outer.rotation * inner.rotation, outer.apply(inner.translation)};
}

double distance_between(const RigidTransform& a, const RigidTransform& b, double length_m) {
  const core::Mat3 between = a.rotation.transposed() * b.rotation;
  const double trace = between.rows[0].x + between.rows[1].y + between.rows[2].z;
  return std::acos(std::clamp((trace - 1) / 2, -1.0, 1.0)) + norm(a.translation - b.translation) / length_m;
}

RelativePose relative_pose(const std::vector<RigidTransform>& first, const std::vector<RigidTransform>& second,
                           const std::optional<RigidTransform>& ambiguous_turn) {
  std::vector<std::vector<RigidTransform>> candidates;  // by instant: one, or one for each end up
  double length_m = 0;
  for (std::size_t i = 0; i < first.size(); ++i) {
    candidates.push_back({first[i] * second[i].inverse()});
    if (ambiguous_turn) candidates.back().push_back(first[i] * *ambiguous_turn * second[i].inverse());
    length_m += norm(second[i].translation) / double(first.size());
  }
  // Wrong instants count no more than so much each.
  constexpr double kMost = 0.3;
  const auto cost = [&](const RigidTransform& pose) {
    double sum = 0;
    for (const auto& options : candidates) {
      double nearest = kMost;
      for (const RigidTransform& option : options)
        nearest = std::min(nearest, distance_between(pose, option, length_m));
      sum += nearest;
    }
    return sum;
  };
  RelativePose best;
  double best_cost = INFINITY;
  std::vector<std::pair<double, const RigidTransform*>> all;
  for (const auto& options : candidates) {
    for (const RigidTransform& option : options) {
      all.emplace_back(cost(option), &option);
      if (all.back().first < best_cost) {
        best_cost = all.back().first;
        best.first_from_second = option;
      }
    }
  }
  for (const auto& [other_cost, other] : all) {
    // Another pose, not the same one from another instant.
    const bool differs = distance_between(*other, best.first_from_second, length_m) > kMost;
    if (ambiguous_turn && differs && other_cost < 2 * best_cost + 0.02) best.certain = false;
  }
  return best;
}

}  // namespace lightstage::calib
