#include "calib/light_gain.h"

#include <algorithm>
#include <cmath>

#include "calib/ball/cone.h"
#include "calib/ball/hit.h"
#include "calib/robust/quantile.h"
#include "calib/spot/ball_region.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

using core::Vec3;

constexpr double kRimPx = 2;           // pixels this near the outline also see the background
constexpr double kLeastCosine = 0.15;  // below it the lamp's size and the surface's gloss matter
constexpr int kLeastPixels = 64;
constexpr double kFloorOfVariance =
    0.05;  // read noise next to shot noise, on the scale of a white surface facing the light

// A pixel that sees the lit ball.
struct Sample {
  double predicted = 0;  // radiance for unit gain
  const float* pixel = nullptr;
};

std::vector<Sample> lit_samples(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                double albedo, Vec3 light, double saturation) {
  const Cone cone = cone_around(camera, ball);
  const double radius_px = outline_radius_px(camera, cone);
  const auto middle = pixel_on_cone(camera, cone, 0, 0);
  const double margin = kRimPx / radius_px;
  const double reach = 1.2 * radius_px + 2;  // perspective and distortion make the outline a little oval
  const int top = std::clamp(static_cast<int>(middle->y - reach), 0, picture.height());
  const int bottom = std::clamp(static_cast<int>(middle->y + reach) + 1, 0, picture.height());
  const int left = std::clamp(static_cast<int>(middle->x - reach), 0, picture.width());
  const int right = std::clamp(static_cast<int>(middle->x + reach) + 1, 0, picture.width());
  const double stage_distance = norm(light);
  std::vector<Sample> samples;
  for (int y = top; y < bottom; ++y) {
    for (int x = left; x < right; ++x) {
      const float* pixel = picture.pixel(y, x);
      const bool clipped = saturation > 0 && std::any_of(pixel, pixel + picture.channels(),
                                                         [&](float v) { return v >= kClippedShare * saturation; });
      if (clipped) continue;
      const std::optional<BallHit> hit = hit_ball(camera, ball, {double(x), double(y)});
      if (!hit || hit->miss > 1 - margin) continue;
      const Vec3 to_light = light - (ball.centre + hit->normal * ball.radius_m);
      const double distance = norm(to_light);
      const double cosine = dot(hit->normal, to_light) / distance;
      if (cosine < kLeastCosine) continue;
      const double falloff = stage_distance / distance;
      samples.push_back({albedo * cosine * falloff * falloff, pixel});
    }
  }
  return samples;
}

struct ChannelFit {
  double gain = 0;
  double sigma = 0;
};

// Weighted least squares through the origin; the variance of a pixel grows with its signal. Pixels more than
// four robust standard deviations off (dust, gloss, a label) are left out, three times over.
template <class Value>
ChannelFit fit_channel(const std::vector<Sample>& samples, Value value) {
  const auto weight = [](const Sample& s) { return 1 / (s.predicted + kFloorOfVariance); };
  std::vector<char> used(samples.size(), 1);
  std::vector<double> residuals(samples.size());
  ChannelFit fit;
  for (int round = 0; round < 4; ++round) {
    double sum_xx = 0, sum_xy = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      if (used[i] == 0) continue;
      const double w = weight(samples[i]);
      sum_xx += w * samples[i].predicted * samples[i].predicted;
      sum_xy += w * samples[i].predicted * value(samples[i]);
    }
    fit.gain = sum_xy / sum_xx;
    double squares = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      residuals[i] = (value(samples[i]) - fit.gain * samples[i].predicted) * std::sqrt(weight(samples[i]));
      if (used[i] == 0) continue;
      squares += residuals[i] * residuals[i];
      ++count;
    }
    fit.sigma = count > 1 ? std::sqrt(squares / double(count - 1) / sum_xx) : 0;
    const double limit = 4 * robust_sigma(residuals);
    for (std::size_t i = 0; i < samples.size(); ++i) used[i] = std::abs(residuals[i]) <= limit;
  }
  return fit;
}

}  // namespace

GainEstimate estimate_gain(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball, double albedo,
                           core::Vec3 light_position, double saturation) {
  if (!(albedo > 0) || !std::isfinite(albedo)) throw core::BadInput("grey ball: its albedo must be positive");
  require_picture_of(picture, camera, "grey ball");
  if (picture.channels() != 1 && picture.channels() != 3) {
    throw core::BadInput("grey ball: the picture must have 1 or 3 channels");
  }
  if (!(norm(light_position - ball.centre) > ball.radius_m)) {
    throw core::BadInput("grey ball: the light lies inside the ball");
  }
  GainEstimate estimate;
  const std::vector<Sample> samples = lit_samples(picture, camera, ball, albedo, light_position, saturation);
  if (samples.size() < std::size_t(kLeastPixels)) {
    estimate.reason = "only " + std::to_string(samples.size()) + " pixels of the ball are lit, seen and not clipped";
    return estimate;
  }
  double gain_sum = 0;
  double variance_sum = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const std::size_t channel = picture.channels() == 3 ? c : 0;
    const ChannelFit fit = fit_channel(samples, [channel](const Sample& s) { return double(s.pixel[channel]); });
    estimate.gain[c] = fit.gain;
    gain_sum += fit.gain;
    variance_sum += fit.sigma * fit.sigma;
  }
  // A dead light shows the dark frame's noise, in which a gain of 0 is as good as any other.
  constexpr double kDarkSigmas = 5;
  if (!(gain_sum > kDarkSigmas * std::sqrt(variance_sum))) {
    estimate = {};
    estimate.reason = "the ball is dark";
    return estimate;
  }
  estimate.measured = true;
  estimate.relative_sigma = std::sqrt(3 * variance_sum) / gain_sum;
  return estimate;
}

}  // namespace lightstage::calib
