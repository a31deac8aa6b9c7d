#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "calib/mirror_ball.h"
#include "calib/ball/cone.h"
#include "calib/ball/hit.h"
#include "calib/robust/quantile.h"

namespace lightstage::calib {

namespace {

constexpr double kClippedShare = 0.97;        // of the saturation: noise and a subtracted dark frame lower it a little
constexpr double kDetectionSigmas = 7;        // above them something is a highlight
constexpr double kLowestShare = 1e-3;         // of the peak: dimmer pixels do not count
constexpr double kLargestShareOfRadius = 0.25;  // a highlight's radius over the ball's: larger ones are no highlights

// The part of a picture around the ball, some pixels more on every side.
struct BallRegion {
  cv::Rect box;
  cv::Mat_<float> signal;    // mean over the channels
  cv::Mat_<uchar> on_ball;   // the ball and one pixel all round
  cv::Mat_<uchar> clipped;
  double radius_px = 0;
};

std::optional<BallRegion> cut_out(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                  double saturation) {
  constexpr int kSides = 256;
  constexpr int kFractionBits = 4;
  const Cone cone = cone_around(camera, ball);
  BallRegion region;
  region.radius_px = outline_radius_px(camera, cone);
  const double pixel_angle = cone.half_angle / region.radius_px;
  std::vector<cv::Point> outline;
  std::vector<cv::Point2f> corners;
  for (int i = 0; i < kSides; ++i) {
    const auto p = pixel_on_cone(camera, cone, 2 * std::numbers::pi * i / kSides, cone.half_angle + pixel_angle);
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

// Standard deviation of the noise on the ball, from second differences. The 90th percentile instead of the median, since
// coarse quantisation makes most differences of a dark picture 0.
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

// What stands out as a small bright spot: the signal less its morphological opening, and of each pixel and its neighbours
// the second brightest, so that one hot pixel is nothing.
cv::Mat_<float> spots(const BallRegion& region) {
  const int radius = std::max(2, static_cast<int>(std::ceil(kLargestShareOfRadius * region.radius_px)));
  const cv::Mat brush = cv::getStructuringElement(cv::MORPH_RECT, {2 * radius + 1, 2 * radius + 1});
  cv::Mat_<float> tall;
  cv::morphologyEx(region.signal, tall, cv::MORPH_TOPHAT, brush, {-1, -1}, 1, cv::BORDER_REPLICATE);
  cv::Mat_<float> second = cv::Mat_<float>::zeros(tall.size());
  for (int y = 0; y < tall.rows; ++y) {
    for (int x = 0; x < tall.cols; ++x) {
      if (region.on_ball(y, x) == 0) continue;
      float first = 0;
      for (int dy = std::max(0, y - 1); dy <= std::min(tall.rows - 1, y + 1); ++dy) {
        for (int dx = std::max(0, x - 1); dx <= std::min(tall.cols - 1, x + 1); ++dx) {
          const float value = tall(dy, dx);
          if (value > first) {
            second(y, x) = first;
            first = value;
          } else {
            second(y, x) = std::max(second(y, x), value);
          }
        }
      }
    }
  }
  return second;
}

struct Candidate {
  core::Pixel centre;      // in the region
  double radius_px = 0;    // of the circle that holds it
};

// The connected pixels at half of the tallest spot's height that hold the most light.
std::optional<Candidate> brightest_spot(const BallRegion& region, double noise) {
  const cv::Mat_<float> tall = spots(region);
  double peak = 0;
  cv::minMaxLoc(tall, nullptr, &peak);
  if (!(peak > kDetectionSigmas * noise)) return std::nullopt;
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
  std::vector<cv::Point2f> pixels;
  for (int y = 0; y < tall.rows; ++y) {
    for (int x = 0; x < tall.cols; ++x) {
      if (labels(y, x) == best) pixels.emplace_back(float(x), float(y));
    }
  }
  cv::Point2f centre;
  float radius = 0;
  cv::minEnclosingCircle(pixels, centre, radius);
  if (radius > kLargestShareOfRadius * region.radius_px + 1) return std::nullopt;
  return Candidate{{centre.x, centre.y}, radius};
}

// Median of the ball around a spot.
double level_around(const BallRegion& region, core::Pixel centre, double radius_px) {
  std::vector<double> values;
  const double outer = radius_px + std::max(3.0, 0.5 * radius_px);
  for (int y = 0; y < region.signal.rows; ++y) {
    for (int x = 0; x < region.signal.cols; ++x) {
      const double distance = std::hypot(x - centre.x, y - centre.y);
      if (region.on_ball(y, x) != 0 && distance > radius_px && distance <= outer) values.push_back(region.signal(y, x));
    }
  }
  return quantile(values, 0.5);
}

// What each pixel of a spot counts. Linear: its height, which gives the exact centroid of a spot of any shape, however few pixels it
// measures. Logarithmic, for clipped spots: between the lowest height that counts and the clipped one, height falls by
// orders of magnitude within a pixel or two, so that its logarithm is nearly linear in the distance from the edge: the pixel
// then counts as if that share of it were covered.
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
};

struct Centroid {
  core::Pixel at;
  double sigma_px = 0;
};

// Pixels above the lowest height, connected with the spot's middle, within `radius_px` of it (falling off over the last pixel).
std::optional<Centroid> weighted_centroid(const BallRegion& region, const Weighing& weighing, core::Pixel start,
                                          double radius_px, double noise) {
  constexpr int kIterations = 30;
  constexpr double kSettledPx = 1e-4;
  const cv::Mat_<uchar> above = region.signal > static_cast<float>(weighing.level + weighing.lowest);
  cv::Mat labels_any;
  cv::connectedComponents(above, labels_any, 8, CV_32S);
  const cv::Mat_<int> labels = labels_any;
  // The label of the brightest pixel near the middle.
  int label = 0;
  float brightest = 0;
  for (int y = 0; y < labels.rows; ++y) {
    for (int x = 0; x < labels.cols; ++x) {
      if (labels(y, x) > 0 && std::hypot(x - start.x, y - start.y) <= radius_px && region.signal(y, x) > brightest) {
        brightest = region.signal(y, x);
        label = labels(y, x);
      }
    }
  }
  if (label == 0) return std::nullopt;

  Centroid centroid{start};
  for (int i = 0; i < kIterations; ++i) {
    double sum = 0, sum_x = 0, sum_y = 0, spread = 0, partial = 0;
    for (int y = 0; y < labels.rows; ++y) {
      for (int x = 0; x < labels.cols; ++x) {
        if (labels(y, x) != label) continue;
        const double distance = std::hypot(x - centroid.at.x, y - centroid.at.y);
        const double weight =
            weighing(region.signal(y, x)) * std::clamp(radius_px + 0.5 - distance, 0.0, 1.0);
        sum += weight;
        sum_x += weight * x;
        sum_y += weight * y;
        if (weight > 0) {
          const double height = region.signal(y, x) - weighing.level;
          const double slope = weighing.logarithmic
                                   ? (height < weighing.full ? 1 / (height * std::log(weighing.full / weighing.lowest)) : 0)
                                   : 1 / weighing.full;
          spread += slope * slope * distance * distance / 2;
          partial += 4 * weight * std::max(0.0, 1 - weight);
        }
      }
    }
    if (!(sum > 0)) return std::nullopt;
    const core::Pixel next{sum_x / sum, sum_y / sum};
    const double moved = std::hypot(next.x - centroid.at.x, next.y - centroid.at.y);
    centroid.at = next;
    // Noise, and what the pixel grid leaves unknown of a clipped spot: a third of a pixel when no pixel of its boundary is
    // partly covered, the less the more are.
    const double grid = weighing.logarithmic ? 0.3 / (1 + partial) : 0;
    centroid.sigma_px = std::hypot(noise * std::sqrt(spread) / sum, grid);
    if (moved < kSettledPx) break;
  }
  return centroid;
}

}  // namespace

std::optional<Highlight> find_highlight(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                        double saturation) {
  require_picture_of(picture, camera, "mirror ball");
  constexpr double kSmallestSigmaPx = 0.02;  // lens and sensor are not known any better
  constexpr int kPlateauPixels = 4;
  const std::optional<BallRegion> region = cut_out(picture, camera, ball, saturation);
  if (!region) return std::nullopt;
  const double noise = noise_on_ball(*region);
  const std::optional<Candidate> spot = brightest_spot(*region, noise);
  if (!spot) return std::nullopt;

  const double window_px = 1.25 * spot->radius_px + 2;
  double peak = 0;
  int clipped_pixels = 0;
  const auto near_spot = [&](int x, int y) {
    return std::hypot(x - spot->centre.x, y - spot->centre.y) <= spot->radius_px + 1;
  };
  for (int y = 0; y < region->signal.rows; ++y) {
    for (int x = 0; x < region->signal.cols; ++x) {
      if (!near_spot(x, y)) continue;
      peak = std::max(peak, double(region->signal(y, x)));
      clipped_pixels += region->clipped(y, x) != 0;
    }
  }
  // Where the saturation is not known, a plateau shows it.
  int plateau_pixels = 0;
  for (int y = 0; y < region->signal.rows; ++y) {
    for (int x = 0; x < region->signal.cols; ++x) {
      plateau_pixels += near_spot(x, y) && region->signal(y, x) >= kClippedShare * peak;
    }
  }
  Highlight highlight;
  highlight.peak = peak;
  highlight.clipped = clipped_pixels > 0 || (saturation <= 0 && plateau_pixels >= kPlateauPixels);

  Weighing weighing;
  weighing.logarithmic = highlight.clipped;
  weighing.level = level_around(*region, spot->centre, window_px + 1);
  weighing.full = kClippedShare * (peak - weighing.level);
  weighing.lowest = std::max(4 * noise, kLowestShare * weighing.full);
  if (!(weighing.full > 2 * weighing.lowest)) weighing.lowest = 0.5 * weighing.full;
  if (!(weighing.full > 0)) return std::nullopt;
  const std::optional<Centroid> centroid = weighted_centroid(*region, weighing, spot->centre, window_px, noise);
  if (!centroid) return std::nullopt;
  highlight.position = {centroid->at.x + region->box.x, centroid->at.y + region->box.y};
  highlight.sigma_px = std::max(centroid->sigma_px, kSmallestSigmaPx);
  return highlight;
}

}  // namespace lightstage::calib
