#include "calib/light_bundle.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>

#include "calib/ball/cone.h"
#include "calib/mirror_ball.h"
#include "core/direction.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::calib {

namespace {

using core::Vec3;
using Block = std::array<double, 3>;

constexpr double kOutlierSigmas = 5;
constexpr double kCauchySigmas = 2;

Vec3 vec(const double* p) {
  return {p[0], p[1], p[2]};
}
Block block(Vec3 v) {
  return {v.x, v.y, v.z};
}

// A highlight's distance from where it should be, over its standard error.
struct HighlightCost {
  const core::CameraModel* camera;
  double radius_m;
  core::Pixel seen;
  double sigma_px;

  bool operator()(const double* light, const double* centre, double* residuals) const {
    const std::optional<core::Pixel> p = predict_highlight(*camera, {vec(centre), radius_m, 0, 0}, vec(light));
    if (!p) return false;
    residuals[0] = (p->x - seen.x) / sigma_px;
    residuals[1] = (p->y - seen.y) / sigma_px;
    return true;
  }
};

// A ball's cone against the one its outline gave: two coordinates of its axis, and its half angle.
struct OutlineCost {
  const core::CameraModel* camera;
  double radius_m;
  Cone seen;
  Vec3 right, down;                 // across the seen axis, camera frame
  double axis_sigma, radius_sigma;  // radians

  bool operator()(const double* centre, double* residuals) const {
    const Vec3 p = camera->stage_from_camera.inverse().apply(vec(centre));
    const double distance = norm(p);
    if (!(distance > radius_m) || !(p.z > 0)) return false;
    residuals[0] = dot(p, right) / distance / axis_sigma;
    residuals[1] = dot(p, down) / distance / axis_sigma;
    residuals[2] = (std::asin(radius_m / distance) - seen.half_angle) / radius_sigma;
    return true;
  }
};

struct DistanceCost {
  LightDistance known;
  template <class T>
  bool operator()(const T* light, T* residual) const {
    using std::sqrt;
    residual[0] =
        (sqrt(light[0] * light[0] + light[1] * light[1] + light[2] * light[2]) - known.metres) / known.sigma_m;
    return true;
  }
};

OutlineCost outline_cost(const core::CameraModel& camera, const Sphere& sphere) {
  const Cone cone = cone_around(camera, sphere);
  const double pixel = cone.half_angle / outline_radius_px(camera, cone);
  const OutlineSigma sigma = outline_sigma(sphere);
  const Vec3 helper = std::abs(cone.axis.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  const Vec3 across = cross(helper, cone.axis);
  const Vec3 right = across / norm(across);
  // A ball that is taken as exact still needs a finite weight.
  constexpr double kExactPx = 1e-4;
  return {&camera,
          sphere.radius_m,
          cone,
          right,
          cross(cone.axis, right),
          pixel * std::max(kExactPx, sigma.centre_px),
          pixel * std::max(kExactPx, sigma.radius_px)};
}

struct Light {
  int index = 0;
  std::vector<const HighlightSeen*> seen;
  std::optional<LightDistance> distance;
  Block position{};
  bool placed = true;
  std::string reason;
};

// Nearest point to all rays, least squares; nothing when they are as good as parallel or it lies behind them.
std::optional<Vec3> meeting_point(const std::vector<ReflectedRay>& rays) {
  Eigen::Matrix3d left = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const ReflectedRay& ray : rays) {
    const Eigen::Vector3d d(ray.direction.x, ray.direction.y, ray.direction.z);
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - d * d.transpose();
    left += across;
    right += across * Eigen::Vector3d(ray.origin.x, ray.origin.y, ray.origin.z);
  }
  constexpr double kSmallestDeterminant = 1e-7;
  if (!(left.determinant() > kSmallestDeterminant)) return std::nullopt;
  const Eigen::Vector3d p = left.ldlt().solve(right);
  const Vec3 point{p.x(), p.y(), p.z()};
  const bool ahead = std::all_of(rays.begin(), rays.end(),
                                 [&](const ReflectedRay& ray) { return dot(point - ray.origin, ray.direction) > 0; });
  return ahead ? std::optional(point) : std::nullopt;
}

class Bundle {
 public:
  explicit Bundle(const BundleInput& input) : input_(input) {
    check();
    for (const OutlineSeen& outline : input.outlines) {
      if (outline.ball >= balls_.size()) {
        balls_.resize(outline.ball + 1);
        centres_.resize(outline.ball + 1);
      }
      if (balls_[outline.ball].radius_m == 0) balls_[outline.ball] = outline.sphere;
    }
    for (std::size_t b = 0; b < balls_.size(); ++b) {
      if (balls_[b].radius_m == 0)
        throw core::BadInput("bundle adjustment: ball " + std::to_string(b) + " has no outline");
      centres_[b] = block(balls_[b].centre);
    }
    std::map<int, Light> lights;
    for (const HighlightSeen& seen : input.highlights) {
      if (seen.ball >= balls_.size())
        throw core::BadInput("bundle adjustment: a highlight lies on a ball without an outline");
      lights[seen.light_index].index = seen.light_index;
      lights[seen.light_index].seen.push_back(&seen);
    }
    for (auto& [index, light] : lights) {
      const auto known = input.distances.find(index);
      if (known != input.distances.end()) light.distance = known->second;
      lights_.push_back(std::move(light));
    }
    for (Light& light : lights_) start(light);
  }

  BundleResult solve() {
    minimise(true);
    // Wrong highlights pull at the balls as well: the worst first, then all again.
    constexpr int kRounds = 4;
    for (int round = 0; round < kRounds && leave_out_outliers(); ++round) minimise(round + 1 < kRounds);
    minimise(false);
    // Again with the standard errors that the residuals show; how many of these are redundant depends on them a little.
    constexpr int kScalings = 2;
    for (int i = 0; i < kScalings && scale_errors(); ++i) minimise(false);
    return result();
  }

 private:
  void check() const {
    const auto camera_exists = [&](std::size_t camera) { return camera < input_.cameras.size(); };
    for (const OutlineSeen& outline : input_.outlines) {
      if (!camera_exists(outline.camera) || !(outline.sphere.radius_m > 0)) {
        throw core::BadInput("bundle adjustment: an outline names no camera, or has no radius");
      }
    }
    for (const HighlightSeen& seen : input_.highlights) {
      if (!camera_exists(seen.camera) || !(seen.sigma_px > 0)) {
        throw core::BadInput("bundle adjustment: a highlight names no camera, or its standard error is not positive");
      }
    }
    for (const auto& [light, distance] : input_.distances) {
      if (!(distance.metres > 0 && distance.sigma_m > 0)) {
        throw core::BadInput("bundle adjustment: the distance of light " + std::to_string(light) +
                             " and its standard error must be positive");
      }
    }
  }

  void start(Light& light) const {
    std::vector<ReflectedRay> rays;
    for (const HighlightSeen* seen : light.seen) {
      const auto ray = reflect_at(input_.cameras[seen->camera], balls_[seen->ball], seen->position);
      if (ray) rays.push_back(*ray);
    }
    if (rays.size() < light.seen.size()) {
      light.placed = false;
      light.reason = "a highlight lies on the ball's rim";
      return;
    }
    if (rays.size() == 1 && !light.distance) {
      light.placed = false;
      light.reason = "seen only once: its distance needs a second ball or camera, or the stage's radius";
      return;
    }
    std::optional<Vec3> at = rays.size() > 1 ? meeting_point(rays) : std::nullopt;
    constexpr double kUsualDistance = 1.5;
    const double distance = light.distance ? light.distance->metres : kUsualDistance;
    if (!at || (light.distance && std::abs(norm(*at) - distance) > 0.5 * distance)) {
      at = rays.front().origin + rays.front().direction * distance;
    }
    light.position = block(*at);
  }

  std::unique_ptr<ceres::CostFunction> highlight_cost(const HighlightSeen& seen) const {
    return std::make_unique<ceres::NumericDiffCostFunction<HighlightCost, ceres::CENTRAL, 2, 3, 3>>(new HighlightCost{
        &input_.cameras[seen.camera], balls_[seen.ball].radius_m, seen.position, scale_ * seen.sigma_px});
  }

  // The problem owns what is given to it.
  void build(ceres::Problem& problem, bool robust) {
    for (const OutlineSeen& outline : input_.outlines) {
      problem.AddResidualBlock(new ceres::NumericDiffCostFunction<OutlineCost, ceres::CENTRAL, 3, 3>(
                                   new OutlineCost(outline_cost(input_.cameras[outline.camera], outline.sphere))),
                               nullptr, centres_[outline.ball].data());
    }
    for (Light& light : lights_) {
      if (!light.placed) continue;
      for (const HighlightSeen* seen : light.seen) {
        problem.AddResidualBlock(highlight_cost(*seen).release(),
                                 robust ? new ceres::CauchyLoss(kCauchySigmas) : nullptr, light.position.data(),
                                 centres_[seen->ball].data());
      }
      if (light.distance) {
        problem.AddResidualBlock(new ceres::AutoDiffCostFunction<DistanceCost, 1, 3>(new DistanceCost{*light.distance}),
                                 nullptr, light.position.data());
      }
    }
  }

  void minimise(bool robust) {
    ceres::Problem problem;
    build(problem, robust);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    options.max_num_iterations = 60;
    options.function_tolerance = 1e-12;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
  }

  // Standard errors by which a highlight is off where the fit has it.
  double misfit(const Light& light, const HighlightSeen& seen) const {
    const HighlightCost cost{&input_.cameras[seen.camera], balls_[seen.ball].radius_m, seen.position, seen.sigma_px};
    double residuals[2];
    if (!cost(light.position.data(), centres_[seen.ball].data(), residuals)) return 1e6;
    return std::hypot(residuals[0], residuals[1]);
  }

  bool leave_out_outliers() {
    bool changed = false;
    for (Light& light : lights_) {
      if (!light.placed) continue;
      const auto worst = std::max_element(light.seen.begin(), light.seen.end(), [&](const auto* a, const auto* b) {
        return misfit(light, *a) < misfit(light, *b);
      });
      const double off = misfit(light, **worst);
      if (!(off > kOutlierSigmas)) continue;
      changed = true;
      const std::string where = !(*worst)->where.empty() ? (*worst)->where
                                                         : "camera " + std::to_string((*worst)->camera) + ", ball " +
                                                               std::to_string((*worst)->ball);
      const std::string by = core::number_text(off * (*worst)->sigma_px, 2) + " px";
      if (light.seen.size() > 2) {
        light.reason += (light.reason.empty() ? "without " : "; ") + where + ": its highlight is off by " + by;
        light.seen.erase(worst);
      } else {
        light.placed = false;
        light.reason = light.seen.size() == 2 ? "its highlights contradict each other by " + by
                                              : "its highlight contradicts the distance given by " + by;
      }
    }
    return changed;
  }

  // How many of the highlights' coordinates are redundant: their number less the trace of their part of the hat matrix, so that what distances
  // and outlines add to the fit is not counted as theirs. Nothing where the fit does not determine all lights.
  std::optional<double> redundancy() {
    ceres::Problem problem;
    build(problem, false);
    std::vector<std::pair<const double*, const double*>> wanted;
    for (const Block& centre : centres_) wanted.emplace_back(centre.data(), centre.data());
    for (const Light& light : lights_) {
      if (!light.placed) continue;
      wanted.emplace_back(light.position.data(), light.position.data());
      std::set<std::size_t> balls;
      for (const HighlightSeen* seen : light.seen) balls.insert(seen->ball);
      for (const std::size_t ball : balls) wanted.emplace_back(light.position.data(), centres_[ball].data());
    }
    ceres::Covariance::Options options;
    options.num_threads = 1;
    ceres::Covariance covariance(options);
    if (!covariance.Compute(wanted, &problem)) return std::nullopt;
    using Matrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    using Matrix23 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
    const auto block_of = [&](const Block& a, const Block& b) {
      Matrix3 block;
      covariance.GetCovarianceBlock(a.data(), b.data(), block.data());
      return block;
    };
    double sum = 0;
    for (const Light& light : lights_) {
      if (!light.placed) continue;
      for (const HighlightSeen* seen : light.seen) {
        const Block& centre = centres_[seen->ball];
        const std::unique_ptr<ceres::CostFunction> cost = highlight_cost(*seen);
        const double* parameters[]{light.position.data(), centre.data()};
        Matrix23 by_light, by_ball;
        double* jacobians[]{by_light.data(), by_ball.data()};
        double residuals[2];
        if (!cost->Evaluate(parameters, residuals, jacobians)) return std::nullopt;
        const double both = (by_light * block_of(light.position, centre) * by_ball.transpose()).trace();
        sum += 2 - (by_light * block_of(light.position, light.position) * by_light.transpose()).trace() - 2 * both -
               (by_ball * block_of(centre, centre) * by_ball.transpose()).trace();
      }
    }
    return sum;
  }

  // What the highlights are off by over what they claim (variance component estimation, Foerstner 1979, one component); false when there are
  // too few of them to tell.
  bool scale_errors() {
    constexpr double kLeastRedundancy = 10;
    if (std::none_of(lights_.begin(), lights_.end(), [](const Light& light) { return light.placed; })) return false;
    const std::optional<double> redundant = redundancy();
    if (!redundant || *redundant < kLeastRedundancy) return false;
    double square = 0;
    for (const Light& light : lights_) {
      if (!light.placed) continue;
      for (const HighlightSeen* seen : light.seen) square += std::pow(misfit(light, *seen), 2);
    }
    // Never lowered: what all views have wrong alike, they agree on.
    scale_ = std::max(1.0, std::sqrt(square / *redundant));
    return true;
  }

  BundleResult result() {
    ceres::Problem problem;
    build(problem, false);
    BundleResult result;
    for (std::size_t b = 0; b < balls_.size(); ++b) {
      result.balls.push_back(balls_[b]);
      result.balls.back().centre = vec(centres_[b].data());
    }
    ceres::Covariance::Options options;
    options.num_threads = 1;
    ceres::Covariance covariance(options);
    std::vector<std::pair<const double*, const double*>> wanted;
    for (const Light& light : lights_) {
      if (light.placed) wanted.emplace_back(light.position.data(), light.position.data());
    }
    const bool known = !wanted.empty() && covariance.Compute(wanted, &problem);
    double sum = 0;
    int count = 0;
    for (Light& light : lights_) {
      BundledLight& out = result.lights.emplace_back();
      out.light_index = light.index;
      out.placed = light.placed && known;
      out.reason = light.placed && !known ? "what is seen does not determine the lights' positions" : light.reason;
      if (!out.placed) continue;
      out.position = vec(light.position.data());
      double c[9];
      covariance.GetCovarianceBlock(light.position.data(), light.position.data(), c);
      out.covariance = {{Vec3{c[0], c[1], c[2]}, Vec3{c[3], c[4], c[5]}, Vec3{c[6], c[7], c[8]}}};
      const double trace = c[0] + c[4] + c[8];
      const Vec3 towards = out.position / norm(out.position);
      const double across = std::max(0.0, trace - dot(towards, out.covariance * towards));
      out.sigma_m = std::sqrt(trace);
      out.sigma_degrees = core::degrees_from_radians(std::sqrt(across) / norm(out.position));
      out.highlights = static_cast<int>(light.seen.size());
      double square = 0;
      for (const HighlightSeen* seen : light.seen) square += std::pow(misfit(light, *seen) * seen->sigma_px, 2);
      out.rms_px = std::sqrt(square / (2.0 * out.highlights));
      sum += square;
      count += 2 * out.highlights;
    }
    result.error_scale = scale_;
    result.rms_px = count > 0 ? std::sqrt(sum / count) : 0;
    return result;
  }

  const BundleInput& input_;
  std::vector<Sphere> balls_;
  std::vector<Block> centres_;
  std::vector<Light> lights_;
  double scale_ = 1;  // of all highlights' standard errors
};

}  // namespace

BundleResult bundle_lights(const BundleInput& input) {
  return Bundle(input).solve();
}

}  // namespace lightstage::calib
