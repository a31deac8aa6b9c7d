#include <cmath>
#include <opencv2/imgproc.hpp>

#include "calib/ball/hit.h"
#include "calib/mirror_ball.h"
#include "calib/robust/quantile.h"
#include "calib/spot/ball_region.h"
#include "calib/spot/brightest_spot.h"

namespace lightstage::calib {

namespace {

constexpr double kDetectionSigmas = 7;    // above them something is a highlight
constexpr double kDetectionContrast = 2;  // and above the unevenness of what surrounds it
constexpr double kLowestShare = 1e-3;     // of the peak: dimmer pixels do not count

// What the ball shows around a spot.
struct Surroundings {
  double level = 0;  // median
  double high = 0;   // 90th percentile: glare, streaks, other spots
};

Surroundings surroundings(const BallRegion& region, const Spot& spot, double margin_px) {
  std::vector<double> values;
  const double outer = margin_px + std::max(3.0, spot.radius_px);
  for (int y = 0; y < region.signal.rows; ++y) {
    for (int x = 0; x < region.signal.cols; ++x) {
      const double distance = spot.distance(y, x);
      if (region.on_ball(y, x) != 0 && distance > margin_px && distance <= outer) values.push_back(region.signal(y, x));
    }
  }
  return {quantile(values, 0.5), quantile(values, 0.9)};
}

// What each pixel of a spot counts. Linear: its height, which gives the exact centroid of a spot of any
// shape, however few pixels it measures. Logarithmic, for clipped spots: between the lowest height that
// counts and the clipped one, height falls by orders of magnitude within a pixel or two, so that its
// logarithm is nearly linear in the distance from the edge: the pixel then counts as if that share of it were
// covered.
struct Weighing {
  bool logarithmic = false;
  double level = 0;   // of the ball around
  double lowest = 0;  // height above that level, from which on pixels count
  double full = 0;    // height that counts 1

  double operator()(double signal) const {
    const double height = signal - level;
    if (!(height > lowest)) return 0;
    if (!logarithmic) return height / full;
    return std::min(1.0, std::log(height / lowest) / std::log(full / lowest));
  }
  // How fast the weight grows with the height.
  double slope(double height) const {
    if (!logarithmic) return 1 / full;
    return height < full ? 1 / (height * std::log(full / lowest)) : 0;
  }
};

struct Centroid {
  core::Pixel at;
  double sigma_px = 0;
};

// Of the pixels that count, connected with the spot's body and within `margin_px` of it (falling off over the
// last pixel).
std::optional<Centroid> weighted_centroid(const BallRegion& region, const Spot& spot, const Weighing& weighing,
                                          double margin_px, double saturation) {
  constexpr double kElectrons = 1e4;  // in a clipped pixel, of sensors in use: their shot noise
  const cv::Mat_<uchar> counting =
      (region.signal > static_cast<float>(weighing.level + weighing.lowest)) & (spot.distance < margin_px + 0.5);
  cv::Mat labels_any;
  const int count = cv::connectedComponents(counting, labels_any, 8, CV_32S);
  const cv::Mat_<int> labels = labels_any;
  std::vector<char> holds_body(std::size_t(count), 0);
  for (int y = 0; y < labels.rows; ++y) {
    for (int x = 0; x < labels.cols; ++x) {
      if (spot.distance(y, x) == 0) holds_body[std::size_t(labels(y, x))] = 1;
    }
  }
  holds_body[0] = 0;

  struct Weighted {
    double x, y, weight, height;
  };
  std::vector<Weighted> pixels;
  double sum = 0, sum_x = 0, sum_y = 0;
  for (int y = 0; y < labels.rows; ++y) {
    for (int x = 0; x < labels.cols; ++x) {
      if (holds_body[std::size_t(labels(y, x))] == 0) continue;
      const double weight =
          weighing(region.signal(y, x)) * std::clamp(margin_px + 0.5 - double(spot.distance(y, x)), 0.0, 1.0);
      pixels.push_back({double(x), double(y), weight, region.signal(y, x) - weighing.level});
      sum += weight;
      sum_x += weight * x;
      sum_y += weight * y;
    }
  }
  if (!(sum > 0)) return std::nullopt;
  Centroid centroid{{sum_x / sum, sum_y / sum}};
  double spread = 0, partial = 0;
  for (const Weighted& p : pixels) {
    const double distance = std::hypot(p.x - centroid.at.x, p.y - centroid.at.y);
    const double noise_squared = region.noise * region.noise + std::max(0.0, p.height) * saturation / kElectrons;
    spread += std::pow(weighing.slope(p.height) * distance, 2) / 2 * noise_squared;
    partial += 4 * p.weight * std::max(0.0, 1 - p.weight);
  }
  // Noise, and what the pixel grid leaves unknown of a clipped spot: a quarter of a pixel when no pixel of its
  // boundary is partly covered, the less the more are (on rendered balls).
  const double grid = weighing.logarithmic ? 0.23 / (1 + partial) : 0;
  centroid.sigma_px = std::hypot(std::sqrt(spread) / sum, grid);
  return centroid;
}

// Near the rim the spot is squeezed, and less of its outer foot counts than of its inner one: on rendered balls it then seems to lie 0.01 to 0.02
// pixels too far inside, from 0.95 of the radius on, however it is clipped.
double rim_sigma(const core::CameraModel& camera, const Sphere& ball, core::Pixel pixel) {
  constexpr double kAtRimPx = 0.03, kFrom = 0.9;
  const std::optional<BallHit> hit = hit_ball(camera, ball, pixel);
  const double share = hit ? std::max(0.0, (hit->miss - kFrom) / (1 - kFrom)) : 1;
  return kAtRimPx * share * share;
}

}  // namespace

std::optional<Highlight> find_highlight(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                        double saturation) {
  require_picture_of(picture, camera, "mirror ball");
  constexpr double kSmallestSigmaPx = 0.018;  // lens and sensor are not known any better
  constexpr int kPlateauPixels = 4;
  const std::optional<BallRegion> region = cut_out_ball(picture, camera, ball, saturation);
  if (!region) return std::nullopt;
  const cv::Mat_<float> steady = without_hot_pixels(region->signal);
  const std::optional<Spot> spot = brightest_spot(*region, steady);
  if (!spot) return std::nullopt;

  double peak = 0;
  double steady_peak = 0;
  const cv::Mat body = spot->distance <= 1;
  cv::minMaxLoc(region->signal, nullptr, &peak, nullptr, nullptr, body);
  cv::minMaxLoc(steady, nullptr, &steady_peak, nullptr, nullptr, body);
  const int clipped_pixels = cv::countNonZero(region->clipped & body);
  const int plateau_pixels = cv::countNonZero((region->signal >= kClippedShare * peak) & body);
  Highlight highlight;
  highlight.peak = peak;
  // Where the saturation is not known, a plateau shows it.
  highlight.clipped = saturation > 0 ? clipped_pixels > 0 : plateau_pixels >= kPlateauPixels;

  const Surroundings around = surroundings(*region, *spot, 2 + spot->radius_px);
  const double unevenness = around.high - around.level;
  if (!(steady_peak - around.level > std::max(kDetectionSigmas * region->noise, kDetectionContrast * unevenness))) {
    return std::nullopt;
  }
  // A clipped spot ends within a pixel or two of its half height; the foot of others is as wide as they are.
  const double margin_px = highlight.clipped ? 2 : 2 + spot->radius_px;
  Weighing weighing;
  weighing.logarithmic = highlight.clipped;
  weighing.level = around.level;
  weighing.full = kClippedShare * (peak - around.level);
  // What is around must not count, be it noise or glare.
  weighing.lowest =
      std::min(std::max({4 * region->noise, kLowestShare * weighing.full, 2 * unevenness}), 0.5 * weighing.full);
  const std::optional<Centroid> centroid = weighted_centroid(*region, *spot, weighing, margin_px, saturation);
  if (!centroid) return std::nullopt;
  highlight.position = {centroid->at.x + region->box.x, centroid->at.y + region->box.y};
  highlight.sigma_px =
      std::hypot(std::max(centroid->sigma_px, kSmallestSigmaPx), rim_sigma(camera, ball, highlight.position));
  highlight.parted = has_two_parts(*region, *spot, highlight.clipped);
  highlight.rival = rival_share(*region, steady, *spot, margin_px);
  return highlight;
}

}  // namespace lightstage::calib
