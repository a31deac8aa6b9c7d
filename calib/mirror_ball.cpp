#include "calib/mirror_ball.h"

#include <algorithm>
#include <cmath>

#include "calib/ball/cone.h"
#include "calib/ball/hit.h"
#include "calib/spot/ball_region.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

using core::Vec3;

// Where a ray that starts inside the stage meets the sphere of `radius` about the stage centre.
Vec3 on_stage(const ReflectedRay& ray, double radius) {
  const double along = dot(ray.origin, ray.direction);
  const double origin = norm(ray.origin);
  const double root = std::sqrt(along * along + (radius - origin) * (radius + origin));
  return ray.origin + ray.direction * (root - along);
}

std::optional<Vec3> light_position(const core::CameraModel& camera, const Sphere& ball, core::Pixel pixel,
                                   double stage_radius_m) {
  const std::optional<ReflectedRay> ray = reflect_at(camera, ball, pixel);
  if (!ray) return std::nullopt;
  return on_stage(*ray, stage_radius_m);
}

// Standard error of the direction in radians: the highlight's position across and along the image, the ball's
// position across the image and its distance are moved one by one by their own standard errors, both ways. A
// movement that takes the highlight off the ball says that the direction is not determined: nothing then.
// `here` is the light's position.
std::optional<double> direction_sigma(const core::CameraModel& camera, const Sphere& ball, const Highlight& highlight,
                                      Vec3 here, double stage_radius_m) {
  const Cone cone = cone_around(camera, ball);
  const double radius_px = outline_radius_px(camera, cone);
  const OutlineSigma outline = outline_sigma(ball);
  const Vec3 sight = ball.centre - camera.centre();
  const Vec3 right = camera.stage_from_camera.rotation * Vec3{1, 0, 0};
  const Vec3 down = camera.stage_from_camera.rotation * Vec3{0, 1, 0};
  const double metres_per_px = ball.radius_m / radius_px;

  struct Step {
    core::Pixel highlight;
    Vec3 ball;
  };
  const double centre_m = outline.centre_px * metres_per_px;
  const std::vector<Step> steps{{{highlight.sigma_px, 0}, {}},
                                {{0, highlight.sigma_px}, {}},
                                {{0, 0}, right * centre_m},
                                {{0, 0}, down * centre_m},
                                {{0, 0}, sight * (outline.radius_px / radius_px)}};
  double variance = 0;
  for (const Step& step : steps) {
    const auto moved = [&](double sign) {
      Sphere there = ball;
      there.centre = ball.centre + step.ball * sign;
      return light_position(
          camera, there,
          {highlight.position.x + sign * step.highlight.x, highlight.position.y + sign * step.highlight.y},
          stage_radius_m);
    };
    const std::optional<Vec3> ahead = moved(1);
    const std::optional<Vec3> back = moved(-1);
    if (!ahead || !back) return std::nullopt;
    // The larger side: near the rim the direction turns faster and faster.
    const double angle = std::max(norm(*ahead - here), norm(here - *back)) / stage_radius_m;
    variance += angle * angle;
  }
  return std::sqrt(variance);
}

// Why a ball shows no highlight.
std::string nothing_seen(const BallPicture& picture, const core::CameraModel& camera, const Sphere& ball) {
  constexpr double kMostClipped = 0.5;
  const std::optional<BallRegion> region = cut_out_ball(picture.image, camera, ball, picture.saturation);
  if (!region) return "no highlight: the ball is not in the picture";
  const int pixels = cv::countNonZero(region->on_ball);
  if (cv::countNonZero(region->clipped & region->on_ball) > kMostClipped * pixels) {
    return "overexposed: most of the ball is clipped";
  }
  return "no highlight on the ball";
}

// A highlight at the very border of the picture may go on beyond it.
bool cut_by_border(const Highlight& highlight, const core::CameraModel& camera) {
  constexpr double kMarginPx = 1.5;
  return highlight.position.x < kMarginPx || highlight.position.y < kMarginPx ||
         highlight.position.x > camera.width - 1 - kMarginPx || highlight.position.y > camera.height - 1 - kMarginPx;
}

}  // namespace

std::optional<ReflectedRay> reflect_at(const core::CameraModel& camera, const Sphere& ball, core::Pixel pixel) {
  const std::optional<BallHit> hit = hit_ball(camera, ball, pixel);
  if (!hit) return std::nullopt;
  const Vec3 reflected = hit->view - hit->normal * (2 * dot(hit->view, hit->normal));
  return ReflectedRay{ball.centre + hit->normal * ball.radius_m, reflected / norm(reflected)};
}

LightEstimate estimate_light(const BallPicture& picture, const core::CameraModel& camera, const Sphere& ball,
                             double stage_radius_m, double largest_sigma_degrees) {
  if (!(stage_radius_m > norm(ball.centre) + ball.radius_m)) {
    throw core::BadInput("mirror ball: it must lie inside the stage's sphere of " + std::to_string(stage_radius_m) +
                         " m about the stage centre");
  }
  LightEstimate estimate;
  estimate.light_index = picture.light_index;
  const std::optional<Highlight> highlight = find_highlight(picture.image, camera, ball, picture.saturation);
  if (!highlight) {
    estimate.reason = nothing_seen(picture, camera, ball);
    return estimate;
  }
  estimate.highlight = highlight;
  if (highlight->rival > kDoubleShare) {
    estimate.reason = "double: two highlights of like strength on the ball";
    return estimate;
  }
  if (highlight->parted) {
    estimate.reason = "double: two highlights that touch on the ball";
    return estimate;
  }
  if (cut_by_border(*highlight, camera)) {
    estimate.reason = "the highlight is cut by the picture's border";
    return estimate;
  }
  const std::optional<Vec3> position = light_position(camera, ball, highlight->position, stage_radius_m);
  if (!position) {
    estimate.reason = "the highlight lies on the ball's rim";
    return estimate;
  }
  estimate.position = *position;
  estimate.direction = core::Direction::from_vector(*position);
  const std::optional<double> sigma = direction_sigma(camera, ball, *highlight, *position, stage_radius_m);
  estimate.sigma_degrees = sigma ? core::degrees_from_radians(*sigma) : 180;
  estimate.placed = estimate.sigma_degrees <= largest_sigma_degrees;
  if (!estimate.placed) estimate.reason = "the highlight lies too near the ball's rim to tell the direction";
  return estimate;
}

namespace {

// The estimates of one light that agree with the best of them.
LightEstimate combine_one(std::vector<const LightEstimate*> placed) {
  std::stable_sort(placed.begin(), placed.end(),
                   [](const LightEstimate* a, const LightEstimate* b) { return a->sigma_degrees < b->sigma_degrees; });
  std::vector<const LightEstimate*> kept;
  for (const LightEstimate* candidate : placed) {
    const bool disagrees = std::any_of(kept.begin(), kept.end(), [&](const LightEstimate* better) {
      const double apart = core::degrees_from_radians(core::angle_radians(candidate->direction, better->direction));
      return apart > std::max(1.0, 3 * std::hypot(candidate->sigma_degrees, better->sigma_degrees));
    });
    if (!disagrees) kept.push_back(candidate);
  }
  constexpr double kSmallestSigmaDegrees = 1e-6;
  double weight_sum = 0;
  Vec3 direction;
  Vec3 position;
  for (const LightEstimate* estimate : kept) {
    const double sigma = std::max(estimate->sigma_degrees, kSmallestSigmaDegrees);
    const double weight = 1 / (sigma * sigma);
    weight_sum += weight;
    direction = direction + estimate->direction.vec() * weight;
    position = position + estimate->position * weight;
  }
  LightEstimate result = *kept.front();
  if (kept.size() == 1) return result;
  result.direction = core::Direction::from_vector(direction);
  // The mean of points on the stage's sphere lies a little inside it.
  result.position = result.direction.vec() * norm(kept.front()->position);
  result.sigma_degrees = 1 / std::sqrt(weight_sum);
  return result;
}

}  // namespace

std::vector<LightEstimate> combine_estimates(std::span<const std::vector<LightEstimate>> per_ball) {
  std::map<int, std::vector<const LightEstimate*>> by_light;
  for (const std::vector<LightEstimate>& ball : per_ball) {
    for (const LightEstimate& estimate : ball) by_light[estimate.light_index].push_back(&estimate);
  }
  std::vector<LightEstimate> combined;
  for (const auto& [light_index, estimates] : by_light) {
    std::vector<const LightEstimate*> placed;
    std::copy_if(estimates.begin(), estimates.end(), std::back_inserter(placed),
                 [](const LightEstimate* e) { return e->placed; });
    combined.push_back(placed.empty() ? *estimates.front() : combine_one(std::move(placed)));
  }
  return combined;
}

}  // namespace lightstage::calib
