#include "calib/camera_calibration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "calib/board/bundle.h"
#include "calib/board/start.h"
#include "calib/robust/quantile.h"
#include "core/direction.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::calib {

namespace {

using core::RigidTransform;
using core::Vec3;

constexpr std::size_t kFewestViews = 3;
constexpr std::size_t kFewestCorners = 6;
constexpr double kSmallestTilt = 5;          // degrees between two poses of the board
constexpr double kLargestFocalError = 0.05;  // share of the focal length
constexpr double kOutlierSigmas = 6;
constexpr double kViewOutlierRatio = 4;
constexpr double kViewOutlierPx = 0.5;
constexpr const char* kHowToShow =
    "take 10 to 20 pictures of the board, tilted by 20 to 45 degrees about both of its axes, near and far, and in "
    "every corner "
    "of the picture";

class Calibration {
 public:
  explicit Calibration(const CameraCalibrationInput& input) : input_(input) {
    require_usable(input.board);
    for (const BoardView& view : input.views) {
      check(view);
      instants_ = std::max(instants_, view.instant + 1);
    }
    result_.views.resize(input.views.size());
    for (std::size_t v = 0; v < input.views.size(); ++v) {
      const BoardView& view = input.views[v];
      result_.views[v].camera = view.camera;
      result_.views[v].instant = view.instant;
      if (view.corners.size() < kFewestCorners) {
        result_.views[v].reason = view.corners.empty() ? "no board" : "too few corners";
      } else {
        views_.push_back({v, view.camera, view.instant, view.corners});
      }
    }
  }

  CameraCalibration solve() {
    require_enough("show the board");
    CameraBundle rig(input_.board, input_.distortion, input_.cameras.size(), instants_);
    start(rig);
    rig.views = std::move(views_);
    rig.minimise(CameraBundle::Loss::kHuber);
    constexpr int kRounds = 5;
    for (int round = 0; round < kRounds; ++round) {
      rig.estimate_sigmas_by_median();
      rig.minimise(CameraBundle::Loss::kCauchy);
      if (!leave_out_outliers(rig)) break;
    }
    views_ = rig.views;
    require_enough("fit in with the others");
    connected_order();
    rig.minimise(CameraBundle::Loss::kNone);
    rig.estimate_sigmas();
    rig.minimise(CameraBundle::Loss::kNone);
    rig.estimate_sigmas();
    collect(rig);
    return std::move(result_);
  }

 private:
  std::string name(std::size_t camera) const { return "camera '" + input_.cameras[camera].name + "'"; }

  void check(const BoardView& view) const {
    if (view.camera >= input_.cameras.size()) throw core::BadInput("camera calibration: a view names no camera");
    for (const BoardCorner& corner : view.corners) {
      if (corner.id < 0 || corner.id >= input_.board.corner_count() || !std::isfinite(corner.position.x) ||
          !std::isfinite(corner.position.y)) {
        throw core::BadInput("camera calibration: " + name(view.camera) +
                             " sees a corner that the board does not have");
      }
    }
  }

  void require_enough(const std::string& what) const {
    if (input_.cameras.empty()) throw core::BadInput("camera calibration: there are no cameras");
    std::vector<std::size_t> count(input_.cameras.size(), 0);
    for (const CameraBundle::View& view : views_) ++count[view.camera];
    for (std::size_t c = 0; c < count.size(); ++c) {
      if (count[c] >= kFewestViews) continue;
      throw core::BadInput(name(c) + ": " + std::to_string(count[c]) + " of its pictures " + what + ", and at least " +
                           std::to_string(kFewestViews) + " are needed; " + kHowToShow);
    }
  }

  // Each camera by itself, then each in the frame of one that is placed already and shares most instants with it.
  void start(CameraBundle& rig) {
    std::map<std::pair<std::size_t, std::size_t>, RigidTransform> camera_from_board;  // by camera and instant
    for (std::size_t c = 0; c < input_.cameras.size(); ++c) start_camera(c, rig, camera_from_board);
    const bool either_end = input_.board.looks_same_upside_down();
    const RigidTransform turn = half_turn(input_.board);
    for (const auto& [camera, from] : connected_order()) {
      std::vector<RigidTransform> first, second;
      for (std::size_t i = 0; i < instants_; ++i) {
        const auto a = camera_from_board.find({from, i}), b = camera_from_board.find({camera, i});
        if (a == camera_from_board.end() || b == camera_from_board.end()) continue;
        first.push_back(a->second);
        second.push_back(b->second);
      }
      const RelativePose pose = relative_pose(first, second, either_end ? std::optional(turn) : std::nullopt);
      if (!pose.certain) {
        throw core::BadInput(
            name(camera) + ": the board looks the same upside down, and its " + std::to_string(first.size()) +
            " poses before this camera and '" + input_.cameras[from].name +
            "' do not tell which end is up; tilt it more, or use one whose columns and rows add up to an odd "
            "number, or a ChArUco board");
      }
      rig.rig_from_camera[camera] = rig.rig_from_camera[from] * pose.first_from_second;
    }
    std::vector<const CameraBundle::View*> largest(instants_, nullptr);
    for (const CameraBundle::View& view : views_) {
      const CameraBundle::View*& best = largest[view.instant];
      if (best == nullptr || view.corners.size() > best->corners.size()) best = &view;
    }
    for (std::size_t i = 0; i < instants_; ++i) {
      if (largest[i] == nullptr) continue;
      const std::size_t c = largest[i]->camera;
      rig.rig_from_board[i] = rig.rig_from_camera[c] * camera_from_board.at({c, i});
    }
    if (!either_end) return;
    for (CameraBundle::View& view : views_) {
      const RigidTransform expected = rig.rig_from_camera[view.camera].inverse() * rig.rig_from_board[view.instant];
      const RigidTransform& seen = camera_from_board.at({view.camera, view.instant});
      const double length = norm(seen.translation);
      if (distance_between(expected, seen * turn, length) < distance_between(expected, seen, length)) {
        turn_upside_down(input_.board, view.corners);
      }
    }
  }

  // The lens from this camera's views alone, from every focal length worth trying.
  void start_camera(std::size_t camera, CameraBundle& rig,
                    std::map<std::pair<std::size_t, std::size_t>, RigidTransform>& camera_from_board) const {
    const RigCamera& size = input_.cameras[camera];
    const double unit = std::max(size.width, size.height);
    std::vector<const BoardView*> given;
    for (const CameraBundle::View& view : views_) {
      if (view.camera == camera) given.push_back(&input_.views[view.given]);
    }
    std::vector<double> focals{unit, 2 * unit, 5 * unit};
    const std::optional<double> from_views = focal_from_homographies(input_.board, size, given);
    if (from_views) focals.insert(focals.begin(), *from_views);
    std::optional<CameraBundle> best;
    double best_cost = INFINITY;
    for (const double focal : focals) {
      CameraBundle one(input_.board, input_.distortion, 1, instants_);
      one.focal_from = 0.2 * unit;
      one.focal_to = 100 * unit;
      one.lenses[0] = {focal, focal, (size.width - 1) / 2.0, (size.height - 1) / 2.0, 0, 0, 0, 0, 0};
      double cost = INFINITY;
      // Again with poses from the lens found: of a plane's two poses the wrong one may have looked better before.
      for (int pass = 0; pass < 2; ++pass) {
        one.views.clear();
        for (const CameraBundle::View& view : views_) {
          if (view.camera != camera) continue;
          const auto pose = board_pose(input_.board, one.model(0, size), view.corners);
          if (!pose) continue;
          one.views.push_back(view);
          one.views.back().camera = 0;
          one.rig_from_board[view.instant] = *pose;
        }
        if (one.views.size() < kFewestViews) break;
        cost = one.minimise(CameraBundle::Loss::kHuber, pass == 0 ? 25 : 60);
      }
      if (cost < best_cost) {
        best_cost = cost;
        best = one;
      }
      // Nothing is gained from other starts where this one fits to the pixel.
      std::size_t corners = 0;
      for (const CameraBundle::View& view : one.views) corners += view.corners.size();
      if (cost < double(corners)) break;
    }
    if (!best) throw core::BadInput(name(camera) + ": no lens explains where the board's corners are; " + kHowToShow);
    rig.lenses[camera] = best->lenses[0];
    rig.focal_from = std::min(camera == 0 ? 1e12 : rig.focal_from, 0.2 * unit);
    rig.focal_to = std::max(camera == 0 ? 0 : rig.focal_to, 100 * unit);
    for (const CameraBundle::View& view : best->views) {
      camera_from_board[{camera, view.instant}] = best->rig_from_board[view.instant];
    }
    for (const CameraBundle::View& view : views_) {
      if (view.camera != camera || camera_from_board.contains({camera, view.instant})) continue;
      throw core::BadInput(name(camera) + ": no pose of the board explains picture " + std::to_string(view.instant) +
                           "; leave it out");
    }
    require_tilts(camera, *best);
  }

  static double largest_tilt(const CameraBundle& bundle, std::size_t camera) {
    std::vector<Vec3> normals;
    for (const CameraBundle::View& view : bundle.views) {
      if (view.camera != camera) continue;
      const core::Mat3 r =
          bundle.rig_from_camera[camera].rotation.transposed() * bundle.rig_from_board[view.instant].rotation;
      normals.push_back({r.rows[0].z, r.rows[1].z, r.rows[2].z});
    }
    double largest = 0;
    for (std::size_t a = 0; a < normals.size(); ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        largest = std::max(largest, std::acos(std::clamp(dot(normals[a], normals[b]), -1.0, 1.0)));
      }
    }
    return core::degrees_from_radians(largest);
  }

  void require_tilts(std::size_t camera, const CameraBundle& bundle) const {
    const double tilt = largest_tilt(bundle, 0);
    if (tilt >= kSmallestTilt) return;
    throw core::BadInput(name(camera) + ": all views of the board are parallel (within " + core::number_text(tilt, 2) +
                         " degrees), which leaves focal length and distance open; " + kHowToShow);
  }

  // Every camera but the first, with one before it (or the first) that shares most instants with it.
  std::vector<std::pair<std::size_t, std::size_t>> connected_order() const {
    std::vector<std::set<std::size_t>> seen(input_.cameras.size());
    for (const CameraBundle::View& view : views_) seen[view.camera].insert(view.instant);
    std::set<std::size_t> placed{0};
    std::vector<std::pair<std::size_t, std::size_t>> order;
    while (placed.size() < input_.cameras.size()) {
      std::size_t most = 0;
      std::pair<std::size_t, std::size_t> next;
      for (std::size_t c = 0; c < input_.cameras.size(); ++c) {
        if (placed.contains(c)) continue;
        for (const std::size_t p : placed) {
          const auto common = std::size_t(
              std::count_if(seen[c].begin(), seen[c].end(), [&](std::size_t i) { return seen[p].contains(i); }));
          if (common > most) {
            most = common;
            next = {c, p};
          }
        }
      }
      if (most == 0) {
        std::size_t c = 0;
        while (placed.contains(c)) ++c;
        throw core::BadInput(name(c) +
                             ": it never sees the board at the same time as the cameras before it; show the board to "
                             "neighbouring cameras together, or calibrate it alone");
      }
      order.push_back(next);
      placed.insert(next.first);
    }
    return order;
  }

  bool leave_out_outliers(CameraBundle& rig) {
    bool changed = false;
    std::vector<std::vector<double>> typical(input_.cameras.size());
    const auto off = [&](const CameraBundle::View& view) {
      std::vector<double> distances;
      for (const BoardCorner& corner : view.corners) distances.push_back(rig.distance_px(view, corner));
      return quantile(distances, 0.5);
    };
    for (const CameraBundle::View& view : rig.views) typical[view.camera].push_back(off(view));
    std::vector<double> usual;
    for (auto& values : typical) usual.push_back(quantile(values, 0.5));
    std::erase_if(rig.views, [&](const CameraBundle::View& view) {
      const double px = off(view);
      if (px <= std::max(kViewOutlierPx, kViewOutlierRatio * usual[view.camera])) return false;
      result_.views[view.given].reason = "its corners are off by " + core::number_text(px, 2) +
                                         " px where others are off by " + core::number_text(usual[view.camera], 2) +
                                         ": the board moved between the cameras, is bent, or was found wrongly";
      result_.views[view.given].rms_px = px;
      changed = true;
      return true;
    });
    for (CameraBundle::View& view : rig.views) {
      const std::size_t left_out = std::erase_if(view.corners, [&](const BoardCorner& corner) {
        return rig.distance_px(view, corner) > kOutlierSigmas * rig.sigma_px[view.camera];
      });
      changed |= left_out > 0;
    }
    std::erase_if(rig.views, [&](const CameraBundle::View& view) {
      if (view.corners.size() >= kFewestCorners) return false;
      result_.views[view.given].reason = "too few of its corners fit together";
      return true;
    });
    return changed;
  }

  void collect(CameraBundle& rig) {
    const CameraBundle::Errors errors = rig.errors();
    if (!errors.undetermined.empty()) {
      std::vector<std::string> what;
      for (const auto& [camera, parameter] : errors.undetermined) what.push_back(name(camera) + ": " + parameter);
      throw core::BadInput("the pictures of the board leave open " + core::joined(what, ", ") + "; " + kHowToShow +
                           ", or estimate fewer terms of distortion");
    }
    double square = 0;
    std::size_t count = 0;
    result_.cameras.resize(input_.cameras.size());
    for (std::size_t c = 0; c < input_.cameras.size(); ++c) {
      CalibratedCamera& camera = result_.cameras[c];
      camera.camera = input_.cameras[c];
      camera.model = rig.model(c, input_.cameras[c]);
      camera.sigma = errors.sigma[c];
      camera.position_covariance = errors.position_covariance[c];
      camera.sigma_px = rig.sigma_px[c];
      camera.tilt_degrees = largest_tilt(rig, c);
    }
    result_.rig_from_board.resize(instants_);
    for (const CameraBundle::View& view : rig.views) {
      CalibratedView& shown = result_.views[view.given];
      CalibratedCamera& camera = result_.cameras[view.camera];
      shown.used = true;
      result_.rig_from_board[view.instant] = rig.rig_from_board[view.instant];
      double of_view = 0;
      for (const BoardCorner& corner : view.corners) {
        of_view += std::pow(rig.distance_px(view, corner), 2);
        shown.corners.push_back(corner);
        shown.predicted.push_back(rig.predicted(view, corner).value_or(core::Pixel{}));
        const core::CameraModel& m = camera.model;
        const double farthest = std::hypot(std::max(m.cx, m.width - 1 - m.cx), std::max(m.cy, m.height - 1 - m.cy));
        camera.reach =
            std::max(camera.reach, std::hypot(corner.position.x - m.cx, corner.position.y - m.cy) / farthest);
      }
      shown.rms_px = std::sqrt(of_view / double(view.corners.size()));
      const std::size_t given = input_.views[view.given].corners.size();
      if (view.corners.size() < given) {
        shown.reason = "without " + std::to_string(given - view.corners.size()) + " corners that are far off";
      }
      ++camera.views;
      camera.corners += view.corners.size();
      square += of_view;
      count += view.corners.size();
    }
    result_.rms_px = std::sqrt(square / double(count));
    for (std::size_t c = 0; c < result_.cameras.size(); ++c) judge(c);
  }

  void judge(std::size_t c) {
    CalibratedCamera& camera = result_.cameras[c];
    const double focal = std::max(camera.sigma.fx / camera.model.fx, camera.sigma.fy / camera.model.fy);
    const double principal = std::max(camera.sigma.cx, camera.sigma.cy);
    if (!(focal <= kLargestFocalError)) {
      throw core::BadInput(name(c) + ": the pictures leave its focal length uncertain by " +
                           core::number_text(100 * focal, 2) + " %; " + kHowToShow);
    }
    const auto warn = [&](const std::string& text) { camera.warnings.push_back(text); };
    if (focal > 0.002) {
      warn("its focal length is certain to " + core::number_text(100 * focal, 2) +
           " % only: tilt the board more (20 to 45 degrees) and bring it nearer");
    }
    if (principal > 3) {
      warn("its principal point is certain to " + core::number_text(principal, 2) +
           " px only: tilt the board about both axes, and turn it by a quarter in some pictures");
    }
    if (camera.reach < 0.7 && input_.distortion != DistortionTerms::kNone) {
      warn("corners were seen up to " + std::to_string(int(std::lround(100 * camera.reach))) +
           " % of the way to the picture's corners: distortion beyond is extrapolated; show the board there too");
    }
    constexpr std::size_t kFew = 8;
    if (camera.views < kFew) {
      warn("only " + std::to_string(camera.views) + " pictures of it count: 10 to 20 make standard errors trustworthy");
    }
  }

  const CameraCalibrationInput& input_;
  std::vector<CameraBundle::View> views_;
  std::size_t instants_ = 0;
  CameraCalibration result_;
};

}  // namespace

CameraCalibration calibrate_cameras(const CameraCalibrationInput& input) {
  return Calibration(input).solve();
}

}  // namespace lightstage::calib
