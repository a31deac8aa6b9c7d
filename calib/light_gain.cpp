#include "calib/light_gain.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "calib/ball/cone.h"
#include "calib/ball/grey_ball.h"
#include "calib/ball/hit.h"
#include "calib/robust/quantile.h"
#include "calib/spot/ball_region.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

using core::Vec3;

constexpr double kFloorOfVariance =
    0.05;  // read noise next to shot noise, on the scale of a white surface facing the light

// What is not known exactly besides the gains: the light's place, the ball's image sideways, and the radius of the image.
constexpr int kNuisances = 6;
using Nuisances = Eigen::Matrix<double, kNuisances, 1>;
using NuisanceMatrix = Eigen::Matrix<double, kNuisances, kNuisances>;

// A pixel that sees the lit ball.
struct Sample {
  double predicted = 0;  // radiance for unit gain
  Nuisances
      slopes;  // of the prediction: light's x, y, z (metres), outline's shift right and down and its growth (radii)
  const float* pixel = nullptr;
};

// Two unit vectors that make a right-handed frame with a third.
std::array<Vec3, 2> across(Vec3 axis) {
  const Vec3 helper = std::abs(axis.y) < 0.9 ? Vec3{0, 1, 0} : Vec3{1, 0, 0};
  const Vec3 right = cross(helper, axis);
  const Vec3 unit = right / norm(right);
  return {unit, cross(axis, unit)};
}

// radiance = albedo R^2 n . (L - p) / |L - p|^3 and its derivatives. `towards_camera` is the axis about which the outline lies.
void predict(Sample& sample, Vec3 light, Vec3 point, Vec3 normal, double albedo, Vec3 towards_camera,
             const std::array<Vec3, 2>& sideways) {
  const Vec3 to_light = light - point;
  const double d = norm(to_light), facing = dot(normal, to_light), stage_distance2 = dot(light, light);
  const double falloff = albedo * stage_distance2 / (d * d * d);
  sample.predicted = falloff * facing;
  const Vec3 by_light =
      normal * falloff - to_light * (3 * falloff * facing / (d * d)) + light * (2 * albedo * facing / (d * d * d));
  // A ray that misses the outline's centre by more has a normal that leans farther out.
  const double depth = dot(normal, towards_camera);
  const Vec3 outwards = normal - towards_camera * depth;
  const auto by_normal = [&](Vec3 shift) {
    return falloff * dot(shift - towards_camera * (dot(outwards, shift) / depth), to_light);
  };
  sample.slopes << by_light.x, by_light.y, by_light.z, by_normal(sideways[0]), by_normal(sideways[1]),
      by_normal(outwards);
}

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
  const Vec3 to_camera = camera.centre() - ball.centre;
  const Vec3 towards_camera = to_camera / norm(to_camera);
  const std::array<Vec3, 2> sideways = across(towards_camera);
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
      if (dot(hit->normal, to_light) < kLeastCosine * norm(to_light)) continue;
      Sample sample;
      sample.pixel = pixel;
      predict(sample, light, ball.centre + hit->normal * ball.radius_m, hit->normal, albedo, towards_camera, sideways);
      samples.push_back(sample);
    }
  }
  return samples;
}

struct GainFit {
  std::vector<double> gain, sigma;  // a channel
};

// Weighted least squares by Gauss and Newton; the variance of a pixel grows with its signal, and its scale is that of the residuals. Values more than
// four robust standard deviations off (dust, gloss, a label) are left out. `certainty` is the inverse of the nuisances' own covariance.
GainFit fit_gains(const std::vector<Sample>& samples, int channels, const NuisanceMatrix& certainty) {
  const int unknowns = channels + kNuisances;
  const auto weight = [](const Sample& s) { return 1 / (s.predicted + kFloorOfVariance); };
  const auto value = [&](std::size_t i, int c) { return double(samples[i].pixel[c]); };
  std::vector<char> used(samples.size() * std::size_t(channels), 1);
  std::vector<double> residuals(used.size());
  Eigen::VectorXd gain = Eigen::VectorXd::Zero(channels);
  Nuisances off = Nuisances::Zero();
  for (int c = 0; c < channels; ++c) {
    double xx = 0, xy = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double w = weight(samples[i]) * samples[i].predicted;
      xx += w * samples[i].predicted;
      xy += w * value(i, c);
    }
    gain[c] = xy / xx;
  }
  const auto find_residuals = [&] {
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double shape = samples[i].predicted + samples[i].slopes.dot(off);
      const double root = std::sqrt(weight(samples[i]));
      for (int c = 0; c < channels; ++c) {
        residuals[i * std::size_t(channels) + std::size_t(c)] = (value(i, c) - gain[c] * shape) * root;
      }
    }
  };
  Eigen::MatrixXd covariance;
  constexpr int kRounds = 5;
  for (int round = 0; round < kRounds; ++round) {
    find_residuals();
    // Of all values, so that the limit does not tighten round by round.
    const double limit = 4 * robust_sigma(residuals);
    double squares = 0;
    std::size_t count = 0;
    for (std::size_t k = 0; k < used.size(); ++k) {
      used[k] = std::abs(residuals[k]) <= limit;
      if (used[k] == 0) continue;
      squares += residuals[k] * residuals[k];
      ++count;
    }
    const double variance = count > 1 ? squares / double(count - 1) : 0;
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(unknowns, unknowns);
    Eigen::VectorXd side = Eigen::VectorXd::Zero(unknowns);
    Eigen::VectorXd row(unknowns);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double shape = samples[i].predicted + samples[i].slopes.dot(off);
      const double root = std::sqrt(weight(samples[i]));
      for (int c = 0; c < channels; ++c) {
        const std::size_t k = i * std::size_t(channels) + std::size_t(c);
        if (used[k] == 0) continue;
        row.setZero();
        row[c] = root * shape;
        row.tail<kNuisances>() = root * gain[c] * samples[i].slopes;
        normal.selfadjointView<Eigen::Lower>().rankUpdate(row);
        side += row * residuals[k];
      }
    }
    normal = Eigen::MatrixXd(normal.selfadjointView<Eigen::Lower>());
    // A variance of exactly 0 (a picture without noise) would let nothing be known beforehand.
    const double scale = std::max(variance, 1e-14 * gain.squaredNorm());
    normal.bottomRightCorner<kNuisances, kNuisances>() += scale * certainty;
    side.tail<kNuisances>() -= scale * (certainty * off);
    const Eigen::VectorXd step = normal.ldlt().solve(side);
    gain += step.head(channels);
    off += step.tail<kNuisances>();
    covariance = scale * normal.inverse();
  }
  GainFit fit;
  for (int c = 0; c < channels; ++c) {
    fit.gain.push_back(gain[c]);
    fit.sigma.push_back(std::sqrt(std::max(0.0, covariance(c, c))));
  }
  return fit;
}

Eigen::Matrix3d checked_covariance(const core::Mat3& covariance) {
  Eigen::Matrix3d matrix;
  for (int r = 0; r < 3; ++r) {
    const Vec3 row = covariance.rows[std::size_t(r)];
    matrix.row(r) << row.x, row.y, row.z;
  }
  constexpr double kRounding = 1e-9;
  if (!matrix.allFinite() || (matrix - matrix.transpose()).cwiseAbs().maxCoeff() > kRounding * matrix.norm() ||
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(matrix, Eigen::EigenvaluesOnly).eigenvalues()[0] <
          -kRounding * matrix.norm()) {
    throw core::BadInput("grey ball: the covariance of the light's place must be symmetric, finite and not negative");
  }
  return matrix;
}

}  // namespace

GainEstimate estimate_gain(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball, double albedo,
                           core::Vec3 light_position, double saturation, const core::Mat3& light_covariance) {
  if (!(albedo > 0) || !std::isfinite(albedo)) throw core::BadInput("grey ball: its albedo must be positive");
  const Eigen::Matrix3d place = checked_covariance(light_covariance);
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
  const OutlineSigma outline = outline_sigma(ball);
  const double radius_px = outline_radius_px(camera, cone_around(camera, ball));
  constexpr double kExact = 1e-7;  // metres and radii: nothing is more exact, so that every covariance has an inverse
  NuisanceMatrix known = kExact * kExact * NuisanceMatrix::Identity();
  known.topLeftCorner<3, 3>() += place;
  known(3, 3) += std::pow(outline.centre_px / radius_px, 2);
  known(4, 4) += std::pow(outline.centre_px / radius_px, 2);
  known(5, 5) += std::pow(outline.radius_px / radius_px, 2);
  const GainFit fit = fit_gains(samples, picture.channels(), known.inverse());
  double gain_sum = 0, variance_sum = 0, relative_squares = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const std::size_t channel = picture.channels() == 3 ? c : 0;
    estimate.gain[c] = fit.gain[channel];
    estimate.sigma[c] = fit.sigma[channel];
    gain_sum += fit.gain[channel];
    variance_sum += fit.sigma[channel] * fit.sigma[channel];
    relative_squares += std::pow(fit.sigma[channel] / fit.gain[channel], 2) / 3;
  }
  // A dead light shows the dark frame's noise, in which a gain of 0 is as good as any other.
  constexpr double kDarkSigmas = 5;
  if (!(gain_sum > kDarkSigmas * std::sqrt(variance_sum))) {
    estimate = {};
    estimate.reason = "the ball is dark";
    return estimate;
  }
  estimate.measured = true;
  estimate.relative_sigma = std::sqrt(relative_squares);
  return estimate;
}

}  // namespace lightstage::calib
