#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "calib/ball/cone.h"
#include "calib/ball/hit.h"
#include "calib/mirror_ball.h"
#include "calib/robust/quantile.h"

namespace lightstage::calib {

namespace {

constexpr double kClippedShare =
    0.97;  // of the saturation: noise and a subtracted dark frame lower it a little
constexpr double kDetectionSigmas = 7;    // above them something is a highlight
constexpr double kDetectionContrast = 2;  // and above the unevenness of what surrounds it
constexpr double kLowestShare = 1e-3;     // of the peak: dimmer pixels do not count
constexpr double kCircleShare = 0.6;      // of the largest circle in a spot: thinner parts are streaks
constexpr double kLargestShareOfRadius =
    0.25;  // a highlight's radius over the ball's: larger ones are no highlights

// The part of a picture around the ball, some pixels more on every side.
struct BallRegion {
  cv::Rect box;
  cv::Mat_<float> signal;   // mean over the channels
  cv::Mat_<uchar> on_ball;  // the ball and one pixel all round
  cv::Mat_<uchar> clipped;
  double radius_px = 0;
};

std::optional<BallRegion> cut_out(core::ImageView picture, const core::CameraModel& camera,
                                  const Sphere& ball, double saturation) {
  constexpr int kSides = 256;
  constexpr int kFractionBits = 4;
  const Cone cone = cone_around(camera, ball);
  BallRegion region;
  region.radius_px = outline_radius_px(camera, cone);
  const double pixel_angle = cone.half_angle / region.radius_px;
  std::vector<cv::Point> outline;
  std::vector<cv::Point2f> corners;
  for (int i = 0; i < kSides; ++i) {
    const auto p =
        pixel_on_cone(camera, cone, 2 * std::numbers::pi * i / kSides, cone.half_angle + pixel_angle);
    if (!p) return std::nullopt;
    outline.emplace_back(cvRound(p->x * (1 << kFractionBits)), cvRound(p->y * (1 << kFractionBits)));
    corners.emplace_back(float(p->x), float(p->y));
  }
  // A clipped highlight near the rim reaches beyond the ball.
  const int margin = static_cast<int>(std::ceil(kLargestShareOfRadius * region.radius_px));
  const cv::Rect ball_box = cv::boundingRect(corners);
  region.box = cv::Rect(ball_box.x - margin, ball_box.y - margin, ball_box.width + 2 * margin,
                        ball_box.height + 2 * margin) &
               cv::Rect(0, 0, picture.width(), picture.height());
  if (region.box.width < 3 || region.box.height < 3) return std::nullopt;
  cv::Mat_<uchar> whole = cv::Mat_<uchar>::zeros(picture.height(), picture.width());
  cv::fillConvexPoly(whole, outline, cv::Scalar(255), cv::LINE_8, kFractionBits);
  region.on_ball = whole(region.box).clone();

  region.signal.create(region.box.size());
  region.clipped = cv::Mat_<uchar>::zeros(region.box.size());
  const float limit = static_cast<float>(kClippedShare * saturation);
  for (int y = 0; y < region.box.height; ++y) {
    for (int x = 0; x < region.box.width; ++x) {
      const float* pixel = picture.pixel(region.box.y + y, region.box.x + x);
      float sum = 0;
      for (int c = 0; c < picture.channels(); ++c) {
        if (saturation > 0 && pixel[c] >= limit) region.clipped(y, x) = 255;
        sum += pixel[c];
      }
      region.signal(y, x) = sum / static_cast<float>(picture.channels());
    }
  }
  return region;
}

// Standard deviation of the noise on the ball, from second differences. The 90th percentile instead of the
// median, since coarse quantisation makes most differences of a dark picture 0.
double noise_on_ball(const BallRegion& region) {
  std::vector<double> magnitudes;
  const cv::Mat_<float>& v = region.signal;
  for (int y = 1; y + 1 < v.rows; ++y) {
    for (int x = 1; x + 1 < v.cols; ++x) {
      if (region.on_ball(y, x) == 0) continue;
      const auto second = [&](int row) { return double(v(row, x - 1)) - 2.0 * v(row, x) + v(row, x + 1); };
      magnitudes.push_back(std::abs(second(y - 1) - 2 * second(y) + second(y + 1)) / 6);
    }
  }
  return quantile(magnitudes, 0.9) / 1.645;
}

// Of each pixel and its neighbours the second brightest: one hot pixel is nothing.
cv::Mat_<float> without_hot_pixels(const cv::Mat_<float>& values) {
  cv::Mat_<float> result(values.size());
  for (int y = 0; y < values.rows; ++y) {
    for (int x = 0; x < values.cols; ++x) {
      float first = std::numeric_limits<float>::lowest();
      float second = first;
      for (int ny = std::max(0, y - 1); ny <= std::min(values.rows - 1, y + 1); ++ny) {
        for (int nx = std::max(0, x - 1); nx <= std::min(values.cols - 1, x + 1); ++nx) {
          second = std::max(second, std::min(first, values(ny, nx)));
          first = std::max(first, values(ny, nx));
        }
      }
      result(y, x) = second;
    }
  }
  return result;
}

// What stands out as a small bright spot: the signal less its morphological opening (over the ball alone, so
// that its bright limb is no spot).
cv::Mat_<float> spots(const BallRegion& region, const cv::Mat_<float>& steady) {
  constexpr float kNowhere = 1e30F;
  const int radius = std::max(2, static_cast<int>(std::ceil(kLargestShareOfRadius * region.radius_px)));
  const cv::Mat brush = cv::getStructuringElement(cv::MORPH_RECT, {2 * radius + 1, 2 * radius + 1});
  cv::Mat inside;  // the rim's own pixels also see what is behind the ball
  cv::erode(region.on_ball, inside, cv::Mat::ones(5, 5, CV_8U));
  cv::Mat_<float> opened = steady.clone();
  opened.setTo(kNowhere, inside == 0);
  cv::erode(opened, opened, brush);
  opened.setTo(-kNowhere, inside == 0);
  cv::dilate(opened, opened, brush);
  cv::Mat_<float> tall = steady - opened;
  tall.setTo(0, opened < -0.5F * kNowhere);
  tall.setTo(0, region.on_ball == 0);
  return tall;
}

struct Spot {
  cv::Mat_<float> distance;  // of each pixel from the spot's body; 0 in it
  double radius_px = 0;      // of the largest circle in the body
};

// The connected pixels at half of the tallest spot's height that hold the most light.
std::optional<Spot> brightest_spot(const BallRegion& region, const cv::Mat_<float>& steady) {
  const cv::Mat_<float> tall = spots(region, steady);
  double peak = 0;
  cv::minMaxLoc(tall, nullptr, &peak);
  if (!(peak > 0)) return std::nullopt;
  cv::Mat labels_any;
  const int count = cv::connectedComponents(tall > 0.5 * peak, labels_any, 8, CV_32S);
  const cv::Mat_<int> labels = labels_any;
  std::vector<double> flux(std::size_t(count), 0.0);
  for (int y = 0; y < tall.rows; ++y) {
    for (int x = 0; x < tall.cols; ++x) {
      if (labels(y, x) > 0) flux[std::size_t(labels(y, x))] += tall(y, x);
    }
  }
  const auto best = static_cast<int>(std::max_element(flux.begin(), flux.end()) - flux.begin());
  // The body: all circles in those pixels that are nearly as large as the largest. Glare draws streaks, which
  // are thinner.
  cv::Mat_<float> depth;
  cv::distanceTransform(labels == best, depth, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  double radius = 0;
  cv::minMaxLoc(depth, nullptr, &radius);
  if (radius > kLargestShareOfRadius * region.radius_px) return std::nullopt;
  const double share = kCircleShare * radius;
  cv::Mat_<float> from_centres;
  cv::distanceTransform(depth < share, from_centres, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  Spot spot;
  spot.radius_px = radius;
  cv::distanceTransform((labels != best) | (from_centres >= share), spot.distance, cv::DIST_L2,
                        cv::DIST_MASK_PRECISE);
  return spot;
}

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
      if (region.on_ball(y, x) != 0 && distance > margin_px && distance <= outer)
        values.push_back(region.signal(y, x));
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
std::optional<Centroid> weighted_centroid(const BallRegion& region, const Spot& spot,
                                          const Weighing& weighing, double margin_px, double noise) {
  const cv::Mat_<uchar> counting = (region.signal > static_cast<float>(weighing.level + weighing.lowest)) &
                                   (spot.distance < margin_px + 0.5);
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
    spread += std::pow(weighing.slope(p.height) * distance, 2) / 2;
    partial += 4 * p.weight * std::max(0.0, 1 - p.weight);
  }
  // Noise, and what the pixel grid leaves unknown of a clipped spot: a third of a pixel when no pixel of its
  // boundary is partly covered, the less the more are.
  const double grid = weighing.logarithmic ? 0.3 / (1 + partial) : 0;
  centroid.sigma_px = std::hypot(noise * std::sqrt(spread) / sum, grid);
  return centroid;
}

}  // namespace

std::optional<Highlight> find_highlight(core::ImageView picture, const core::CameraModel& camera,
                                        const Sphere& ball, double saturation) {
  require_picture_of(picture, camera, "mirror ball");
  constexpr double kSmallestSigmaPx = 0.02;  // lens and sensor are not known any better
  constexpr int kPlateauPixels = 4;
  const std::optional<BallRegion> region = cut_out(picture, camera, ball, saturation);
  if (!region) return std::nullopt;
  const double noise = noise_on_ball(*region);
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
  if (!(steady_peak - around.level > std::max(kDetectionSigmas * noise, kDetectionContrast * unevenness))) {
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
      std::min(std::max({4 * noise, kLowestShare * weighing.full, 2 * unevenness}), 0.5 * weighing.full);
  const std::optional<Centroid> centroid = weighted_centroid(*region, *spot, weighing, margin_px, noise);
  if (!centroid) return std::nullopt;
  highlight.position = {centroid->at.x + region->box.x, centroid->at.y + region->box.y};
  highlight.sigma_px = std::max(centroid->sigma_px, kSmallestSigmaPx);
  return highlight;
}

}  // namespace lightstage::calib
