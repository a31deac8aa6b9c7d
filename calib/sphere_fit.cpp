#include "calib/sphere_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "calib/ball/cone.h"
#include "calib/ball/hit.h"
#include "calib/outline/blob.h"
#include "calib/outline/edge.h"
#include "calib/robust/quantile.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

constexpr double kSmallestRadiusPx = 8;
constexpr double kLeastShareSeen = 2.0 / 3.0;  // of the outline, inside the picture
constexpr double kLeastShareAgreeing = 0.6;    // of the outline points found
constexpr double kLargestRmsPx = 1.0;
constexpr double kContourTolerancePx = 1.5;
constexpr double kLeastStepInSigmas = 3;

// The picture as it is sampled along lines: highlights are cut down to twice the ball's own level, since only
// the rim matters.
class CappedPicture {
 public:
  CappedPicture(core::ImageView luminance, double cap) : luminance_(luminance), cap_(cap) {}

  bool contains(core::Pixel p) const {
    return p.x >= 0 && p.y >= 0 && p.x <= luminance_.width() - 1 && p.y <= luminance_.height() - 1;
  }
  // Bilinear; p must be inside.
  double sample(core::Pixel p) const {
    const int x = std::min(static_cast<int>(p.x), luminance_.width() - 2);
    const int y = std::min(static_cast<int>(p.y), luminance_.height() - 2);
    const double fx = p.x - x;
    const double fy = p.y - y;
    return (1 - fy) * ((1 - fx) * at(y, x) + fx * at(y, x + 1)) +
           fy * ((1 - fx) * at(y + 1, x) + fx * at(y + 1, x + 1));
  }

 private:
  double at(int y, int x) const { return std::min(double(luminance_(y, x)), cap_); }
  core::ImageView luminance_;
  double cap_;
};

struct OutlineLine {
  double azimuth = 0;
  double px_per_radian = 0;
  std::vector<double> samples;
};

// Lines across the expected outline, one every pixel of its length or 1024; those that leave the picture are
// left out.
struct OutlineLines {
  std::vector<OutlineLine> inside_picture;
  int asked = 0;
};

OutlineLines sample_across(const CappedPicture& picture, const core::CameraModel& camera, const Cone& cone,
                           const RimModel& model, double radius_px) {
  OutlineLines lines;
  lines.asked = std::clamp(static_cast<int>(2 * std::numbers::pi * radius_px), 64, 1024);
  const double small_angle = 0.01 * cone.half_angle;
  for (int i = 0; i < lines.asked; ++i) {
    OutlineLine line;
    line.azimuth = 2 * std::numbers::pi * i / lines.asked;
    const auto rim = pixel_on_cone(camera, cone, line.azimuth, cone.half_angle);
    const auto inner = pixel_on_cone(camera, cone, line.azimuth, cone.half_angle - small_angle);
    const auto outer = pixel_on_cone(camera, cone, line.azimuth, cone.half_angle + small_angle);
    if (!rim || !inner || !outer) continue;
    const core::Pixel across{outer->x - inner->x, outer->y - inner->y};
    const double length = std::hypot(across.x, across.y);
    line.px_per_radian = length / (2 * small_angle);
    const int half = model.sample_count() / 2;
    for (int k = -half; k <= half; ++k) {
      const double s = k * RimModel::kSampleStepPx / length;
      const core::Pixel p{rim->x + s * across.x, rim->y + s * across.y};
      if (!picture.contains(p)) break;
      line.samples.push_back(picture.sample(p));
    }
    if (static_cast<int>(line.samples.size()) == model.sample_count()) lines.inside_picture.push_back(std::move(line));
  }
  return lines;
}

struct RimPoints {
  std::vector<TangentRay> rays;
  double misfit = 0;  // median over the lines
};

RimPoints find_rim(const OutlineLines& lines, const Cone& cone, const RimModel& model, double least_step) {
  RimPoints points;
  std::vector<double> misfits;
  for (const OutlineLine& line : lines.inside_picture) {
    const std::optional<RimModel::Edge> edge = model.fit(line.samples);
    if (!edge || edge->step < least_step) continue;
    const double angle = cone.half_angle + edge->offset_px / line.px_per_radian;
    points.rays.push_back({ray_on_cone(cone, line.azimuth, angle), line.px_per_radian});
    misfits.push_back(edge->misfit);
  }
  points.misfit = quantile(misfits, 0.5);
  return points;
}

[[noreturn]] void fail(const std::string& problem) {
  throw core::BadInput("calibration ball: " + problem +
                       "; photograph the whole ball, evenly lit, in front of a dark background");
}

// The cone through the blob's contour. A contour runs through the centres of the blob's last pixels: good to
// a pixel.
Cone coarse_cone(const Blob& blob, const core::CameraModel& camera) {
  std::vector<TangentRay> rays;
  for (const core::Pixel& p : blob.contour) {
    rays.push_back({camera.ray_in_camera(p), 0.5 * (camera.fx + camera.fy)});
  }
  const std::optional<Cone> cone = consensus_cone(rays, kContourTolerancePx);
  if (!cone) fail("the bright blob has no round outline");
  return *cone;
}

}  // namespace

Sphere locate_sphere(core::ImageView picture, const core::CameraModel& camera, double radius_m) {
  if (!(radius_m > 0) || !std::isfinite(radius_m))
    throw core::BadInput("calibration ball: its radius must be positive");
  require_picture_of(picture, camera, "calibration ball");
  if (picture.width() < 2 * kSmallestRadiusPx || picture.height() < 2 * kSmallestRadiusPx)
    fail("the picture is too small");
  const core::Image luminance = core::to_luminance(picture);
  const Blob blob = find_blob(luminance);
  const CappedPicture capped(luminance, 2 * blob.level);

  Cone cone = coarse_cone(blob, camera);
  double blur = 0.7;
  ConeFit fit;
  // The first pass searches wide, the second finds how blurred the rim is, the third is final.
  for (int pass = 0; pass < 3; ++pass) {
    const double radius_px = outline_radius_px(camera, cone);
    if (!(radius_px >= kSmallestRadiusPx)) {
      fail("its image is smaller than " + std::to_string(int(2 * kSmallestRadiusPx)) + " pixels across");
    }
    const double half_width = std::clamp(0.3 * radius_px, 4.0, 7.0);
    const double search = pass == 0 ? 3 : 2;
    const OutlineLines lines =
        sample_across(capped, camera, cone, RimModel(radius_px, blur, half_width, search), radius_px);
    if (double(lines.inside_picture.size()) < kLeastShareSeen * lines.asked) {
      fail("more than a third of its outline lies outside the picture");
    }
    if (pass == 1) {
      double least = std::numeric_limits<double>::infinity();
      for (const double candidate : {0.5, 0.6, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0}) {
        const RimModel model(radius_px, candidate, half_width, search);
        const double misfit = find_rim(lines, cone, model, kLeastStepInSigmas * blob.noise).misfit;
        if (misfit < least) {
          least = misfit;
          blur = candidate;
        }
      }
    }
    const RimModel model(radius_px, blur, half_width, search);
    const RimPoints points = find_rim(lines, cone, model, kLeastStepInSigmas * blob.noise);
    const std::optional<Cone> start = pass == 0 ? consensus_cone(points.rays, kContourTolerancePx) : cone;
    const std::optional<ConeFit> found = start ? fit_cone(points.rays, *start) : std::nullopt;
    if (!found || found->agreeing < kLeastShareAgreeing * double(lines.inside_picture.size()) ||
        found->rms_px > kLargestRmsPx) {
      fail("the bright blob's outline is no sphere's");
    }
    fit = *found;
    cone = fit.cone;
  }
  return {ball_centre(camera, cone, radius_m), radius_m, fit.rms_px, fit.agreeing};
}

}  // namespace lightstage::calib
