#include "cli/bench/calib_bench.h"

#include <algorithm>
#include <cmath>
#include <fstream>

#include "calib/ball_circle.h"
#include "calib/light_gain.h"
#include "capture/sequence.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "core/stopwatch.h"
#include "sim/sensor.h"

namespace lightstage::cli {

namespace {

using core::Vec3;

constexpr double kBallRadius = 0.06;
constexpr double kCameraDistance = 1.9;
constexpr double kNearest = 1.2, kFarthest = 2.5;  // lights, metres
constexpr core::Nanoseconds kExposure = 20 * core::kMillisecond;

// A camera with a lens, whose picture holds the three balls.
core::CameraModel stage_camera(double longitude_degrees, int ball_px) {
  constexpr double kSeenMetres = 0.62;
  const int pixels = int(std::lround(kSeenMetres / kBallRadius * ball_px));
  const Vec3 position = core::Direction::from_longitude_latitude_degrees(longitude_degrees, 0).vec() * kCameraDistance;
  core::CameraModel camera =
      core::look_at(position, {0, 0, 0}, pixels, pixels,
                    core::degrees_from_radians(2 * std::atan(0.5 * kSeenMetres / kCameraDistance)));
  camera.k1 = -0.08;
  camera.k2 = 0.02;
  camera.p1 = 0.0008;
  camera.p2 = -0.0005;
  return camera;
}

// The part of the picture that shows the ball and a little around it.
core::CameraModel part_with(core::CameraModel camera, const calib::Sphere& ball, int ball_px) {
  constexpr double kMargin = 1.25;
  const std::optional<core::Pixel> middle = camera.project(ball.centre);
  const int side = 2 * int(std::ceil(kMargin * ball_px));
  camera.cx -= std::round(middle->x) - side / 2;
  camera.cy -= std::round(middle->y) - side / 2;
  camera.width = camera.height = side;
  return camera;
}

capture::Stage drawn_stage(const BallStageOptions& options) {
  capture::Stage stage;
  stage.name = "simulated";
  stage.radius_m = 0.5 * (kNearest + kFarthest);
  const std::vector<core::Direction> directions = core::fibonacci_directions(options.lights);
  for (std::size_t i = 0; i < directions.size(); ++i) {
    // All distances in turn, without a pattern over the directions (multiples of the golden ratio).
    const double turn = std::fmod(0.6180339887498949 * double(i + options.seed), 1.0);
    stage.light_positions.push_back(directions[i].vec() * (kNearest + (kFarthest - kNearest) * turn));
  }
  for (std::size_t c = 0; c < BallStage::kCameras; ++c) {
    stage.cameras.push_back({"camera" + std::to_string(c), stage_camera(30.0 * double(c), options.ball_px), 1});
  }
  stage.simulation.seed = options.seed;
  stage.simulation.mount_error_degrees = 1;
  stage.simulation.gain_spread = 0.15;
  return stage;
}

sim::Simulation simulation_of(const BallStageOptions& options, sim::SubjectKind kind, Vec3 place) {
  sim::Simulation simulation;
  simulation.stage = drawn_stage(options);
  simulation.subject.kind = kind;
  simulation.subject.size_m = kBallRadius;
  simulation.subject.albedo = BallStage::kGreyAlbedo;
  simulation.subject.position = place;
  simulation.seed = options.seed;
  simulation.sensor.vignetting = 0;
  return simulation;
}

std::vector<capture::LightLevel> all_on(std::size_t lights) {
  std::vector<capture::LightLevel> levels;
  for (std::size_t i = 0; i < lights; ++i) levels.push_back({int(i)});
  return levels;
}

BallStage::View render(const sim::World& world, const core::CameraModel& camera, bool grey) {
  const std::size_t lights = world.true_lights().size();
  const auto seen = [&](std::span<const capture::LightLevel> levels) {
    core::throw_if_interrupted();
    core::Image image = world.render(camera, levels, 0);
    return grey ? core::to_luminance(image) : image;
  };
  BallStage::View view{camera, seen(all_on(lights)), {}};
  core::Progress progress("rendering balls", lights);
  for (std::size_t i = 0; i < lights; ++i, progress.advance()) {
    const capture::LightLevel light{int(i)};
    view.lights.push_back(seen({&light, 1}));
  }
  return view;
}

double full_on_radiance(std::size_t lights, double times) {
  // As `capture` exposes it (capture/sequence.h).
  return double(kExposure) / (times * double(capture::default_full_on_exposure(kExposure, lights))) / 0.9;
}

std::vector<std::size_t> balls_of(const CalibKnobs& knobs) {
  if (knobs.balls == 1) return {0};
  if (knobs.balls == 2) return {1, 2};
  return {0, 1, 2};
}

double peak(const core::Image& image) {
  return *std::max_element(image.values().begin(), image.values().end());
}

// d^T C^-1 d.
double squared_mahalanobis(const core::Mat3& c, Vec3 d) {
  const auto& [a, b, e] = c.rows;
  const Vec3 scaled = cross(b, e) * d.x + cross(e, a) * d.y + cross(a, b) * d.z;
  return dot(d, scaled) / dot(a, cross(b, e));
}

// The same of the two coordinates across `towards`.
double squared_mahalanobis_across(const core::Mat3& c, Vec3 d, Vec3 towards) {
  const Vec3 helper = std::abs(towards.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  const Vec3 aside = cross(helper, towards);
  const Vec3 u = aside / norm(aside), v = cross(towards, u);
  const double uu = dot(u, c * u), uv = dot(u, c * v), vv = dot(v, c * v);
  const double x = dot(u, d), y = dot(v, d);
  return (vv * x * x - 2 * uv * x * y + uu * y * y) / (uu * vv - uv * uv);
}

double quantile_of(const std::vector<float>& values, double q) {
  return values.empty() ? std::nan("") : core::quantile(values, q);
}

double degrees_between(Vec3 a, Vec3 b) {
  return core::degrees_from_radians(
      core::angle_radians(core::Direction::from_vector(a), core::Direction::from_vector(b)));
}

}  // namespace

BallStage::BallStage(const BallStageOptions& options) : options_(options) {
  for (const Vec3 place : {Vec3{0.005, -0.01, 0.01}, Vec3{-0.2, -0.02, 0.01}, Vec3{0.2, 0.03, -0.02}}) {
    balls_.push_back({place, kBallRadius, 0, 0});
  }
  for (const capture::StageCamera& camera : drawn_stage(options).cameras) cameras_.push_back(camera.model);
}

BallStage::~BallStage() = default;

const sim::World& BallStage::world(std::size_t ball) const {
  std::unique_ptr<sim::World>& world = worlds_[ball];
  if (!world) {
    world = std::make_unique<sim::World>(simulation_of(options_, sim::SubjectKind::kMirrorBall, balls_[ball].centre));
  }
  return *world;
}

const std::vector<core::Light>& BallStage::true_lights() const {
  return world(0).true_lights();
}

const BallStage::View& BallStage::view(std::size_t ball, std::size_t camera) const {
  const auto known = views_.find({ball, camera});
  if (known != views_.end()) return known->second;
  const core::CameraModel part = part_with(cameras_[camera], balls_[ball], options_.ball_px);
  return views_.emplace(std::pair{ball, camera}, render(world(ball), part, true)).first->second;
}

BallStage::View BallStage::grey_view() const {
  const sim::World world(simulation_of(options_, sim::SubjectKind::kGreyBall, {}));
  return render(world, part_with(cameras_.front(), {{}, kBallRadius, 0, 0}, options_.ball_px), false);
}

core::Image BallStage::sensed(const core::Image& radiance, double saturation, std::uint64_t seed) const {
  const double responsivity = double(core::kSecond) / double(kExposure) / saturation;
  sim::SensorSpec spec;
  spec.vignetting = 0;
  return sim::sense(radiance, spec, responsivity, kExposure, options_.seed * 1000003 + seed);
}

double BallStage::full_on_saturation() const {
  return full_on_radiance(options_.lights, 10);
}

PlacedLights place_lights(const BallStage& stage, const CalibKnobs& knobs) {
  const std::size_t lights = stage.options().lights;
  std::vector<float> peaks;
  std::vector<const BallStage::View*> views;
  calib::BundleInput input;
  const std::vector<std::size_t> balls = balls_of(knobs);
  for (std::size_t b = 0; b < balls.size(); ++b) {
    for (std::size_t c = 0; c < std::size_t(knobs.cameras); ++c) {
      views.push_back(&stage.view(balls[b], c));
      input.outlines.push_back({input.cameras.size(), b, {}});
      input.cameras.push_back(views.back()->camera);
      for (const core::Image& light : views.back()->lights) peaks.push_back(float(peak(light)));
    }
  }
  const double saturation = quantile_of(peaks, 0.5) / knobs.clipping;
  if (knobs.balls == 1) {
    constexpr double kUniformSigma = 0.2887;  // of an interval's width
    for (std::size_t i = 0; i < lights; ++i) {
      input.distances[int(i)] = {0.5 * (kNearest + kFarthest), kUniformSigma * (kFarthest - kNearest)};
    }
  }
  // What the sensor gives is made beforehand: the simulator's time is not calibration's.
  std::vector<core::Image> full_on(views.size());
  std::vector<std::vector<core::Image>> pictures(views.size(), std::vector<core::Image>(lights));
  for (std::size_t v = 0; v < views.size(); ++v) {
    full_on[v] = stage.sensed(views[v]->full_on, stage.full_on_saturation(), 7000 + v);
    core::parallel_for(lights, 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        pictures[v][i] = stage.sensed(views[v]->lights[i], saturation, 10000 * (v + 1) + i);
      }
    });
  }

  const core::Stopwatch watch;
  for (std::size_t v = 0; v < views.size(); ++v) {
    core::throw_if_interrupted();
    calib::OutlineSeen& outline = input.outlines[v];
    outline.sphere = calib::locate_sphere(full_on[v], views[v]->camera, kBallRadius);
    std::vector<std::optional<calib::Highlight>> found(lights);
    core::parallel_for(lights, 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        found[i] = find_spot(knobs.method, pictures[v][i], views[v]->camera, outline.sphere, saturation);
      }
    });
    for (std::size_t i = 0; i < lights; ++i) {
      if (!found[i] || found[i]->rival > calib::kDoubleShare) continue;
      input.highlights.push_back({int(i), v, outline.ball, found[i]->position, found[i]->sigma_px});
    }
  }
  PlacedLights placed{calib::bundle_lights(input), 0};
  placed.seconds = watch.seconds();
  return placed;
}

CalibRow judge(const CalibKnobs& knobs, const std::vector<const BallStage*>& stages,
               const std::vector<PlacedLights>& found) {
  CalibRow row;
  row.knobs = knobs;
  row.ball_px = stages.front()->options().ball_px;
  std::vector<float> degrees, metres;
  double direction_squares = 0, position_squares = 0;
  for (std::size_t s = 0; s < stages.size(); ++s) {
    const std::vector<core::Light>& truth = stages[s]->true_lights();
    row.lights += truth.size();
    row.seconds += found[s].seconds;
    for (const calib::BundledLight& light : found[s].bundle.lights) {
      if (!light.placed || light.sigma_degrees > calib::kLargestSigmaDegrees) continue;
      const Vec3 where = *truth[std::size_t(light.light_index)].position;
      const Vec3 off = light.position - where;
      degrees.push_back(float(degrees_between(light.position, where)));
      metres.push_back(float(norm(off)));
      direction_squares += squared_mahalanobis_across(light.covariance, off, where / norm(where)) / 2;
      position_squares += squared_mahalanobis(light.covariance, off) / 3;
    }
  }
  row.placed = degrees.size();
  row.median_degrees = quantile_of(degrees, 0.5);
  row.p95_degrees = quantile_of(degrees, 0.95);
  row.median_m = quantile_of(metres, 0.5);
  row.p95_m = quantile_of(metres, 0.95);
  row.direction_ratio = std::sqrt(direction_squares / double(row.placed));
  row.position_ratio = std::sqrt(position_squares / double(row.placed));
  return row;
}

GainRow measure_gains(const BallStage& stage, const std::vector<calib::BundledLight>& lights) {
  const BallStage::View view = stage.grey_view();
  const std::vector<core::Light>& truth = stage.true_lights();
  const calib::Sphere ball = calib::locate_sphere(stage.sensed(view.full_on, full_on_radiance(truth.size(), 1), 8000),
                                                  view.camera, kBallRadius);
  GainRow row;
  row.lights = truth.size();
  std::vector<float> errors;
  double squares = 0;
  for (const calib::BundledLight& light : lights) {
    if (!light.placed) continue;
    const std::size_t i = std::size_t(light.light_index);
    const calib::GainEstimate estimate =
        calib::estimate_gain(stage.sensed(view.lights[i], BallStage::kGreySaturation, 9000 + i), view.camera, ball,
                             BallStage::kGreyAlbedo, light.position, BallStage::kGreySaturation, light.covariance);
    if (!estimate.measured) continue;
    ++row.measured;
    for (std::size_t c = 0; c < 3; ++c) {
      const double error = estimate.gain[c] / truth[i].gain[c] - 1;
      errors.push_back(float(std::abs(error)));
      squares += std::pow((estimate.gain[c] - truth[i].gain[c]) / estimate.sigma[c], 2);
      row.within_1_percent += std::abs(error) <= 0.01;
    }
  }
  row.median_error = quantile_of(errors, 0.5);
  row.p95_error = quantile_of(errors, 0.95);
  row.within_1_percent /= double(errors.size());
  row.ratio = std::sqrt(squares / double(errors.size()));
  return row;
}

namespace {

std::string numbered(int n, std::size_t digits) {
  std::string text = std::to_string(n);
  text.insert(0, digits - text.size(), '0');
  return text;
}

// Which way a light far away is, by parallel viewing rays on the ball that fills the circle.
std::optional<Vec3> direction_on(SpotMethod method, const core::Image& picture, const calib::Circle& circle) {
  const core::CameraModel camera = calib::distant_camera(picture.width(), picture.height(), circle);
  const calib::Sphere ball{{0, 0, 0}, 1, 0, 0};
  const std::optional<calib::Highlight> spot = find_spot(method, picture, camera, ball, 1);
  const auto ray = spot ? calib::reflect_at(camera, ball, spot->position) : std::nullopt;
  return ray ? std::optional(ray->direction) : std::nullopt;
}

std::vector<PhotographRow> diligent_ball(const std::filesystem::path& folder) {
  const calib::Circle given{{105.5, 97.5}, 71.0};
  const calib::Circle masked =
      calib::locate_circle(core::read_image(folder / "mask.png", {.encoding = core::Encoding::kLinear})).circle;
  std::ifstream file(folder / "light_directions.txt");
  std::vector<std::pair<core::Image, Vec3>> lights;
  for (Vec3 d; file >> d.x >> d.y >> d.z;) {
    const std::string name = numbered(int(lights.size()) + 1, 3) + ".png";
    lights.emplace_back(core::read_image(folder / name, {.encoding = core::Encoding::kLinear}), d);
  }
  std::vector<PhotographRow> rows;
  for (const SpotMethod method : kSpotMethods) {
    for (const bool mask : {false, true}) {
      PhotographRow row{"glossy ball, 96 known lights", mask ? "mask" : "circle given", method};
      for (const auto& [picture, truth] : lights) {
        const auto direction = direction_on(method, picture, mask ? masked : given);
        if (!direction) continue;
        const double off = degrees_between(*direction, truth);
        ++row.lights;
        row.mean_degrees += off;
        row.largest_degrees = std::max(row.largest_degrees, off);
      }
      row.mean_degrees /= double(row.lights);
      rows.push_back(row);
    }
  }
  return rows;
}

std::vector<PhotographRow> two_mirror_balls(const std::filesystem::path& folder) {
  constexpr int kLights = 12;
  std::vector<PhotographRow> rows;
  for (const SpotMethod method : kSpotMethods) {
    PhotographRow row{"two mirror balls, 12 lights", "circles given", method};
    for (int i = 1; i <= kLights; ++i) {
      std::vector<Vec3> seen;
      for (const char* ball : {"LightProbe-1", "LightProbe-2"}) {
        std::ifstream file(folder / ball / "circle_data.txt");
        double x = 0, y_from_bottom = 0, radius = 0;
        if (!(file >> x >> y_from_bottom >> radius)) {
          throw core::BadInput((folder / ball / "circle_data.txt").string() + ": is not x, y and radius of a circle");
        }
        const core::Image picture = core::read_image(folder / ball / ("Image_" + numbered(i, 2) + ".JPG"));
        // Both counts start at 1.
        const auto direction = direction_on(method, picture, {{x - 1, picture.height() - y_from_bottom}, radius});
        if (direction) seen.push_back(*direction);
      }
      if (seen.size() < 2) continue;
      const double apart = degrees_between(seen[0], seen[1]);
      ++row.lights;
      row.mean_degrees += apart;
      row.largest_degrees = std::max(row.largest_degrees, apart);
      row.to_joint_degrees += 0.5 * apart;
    }
    row.mean_degrees /= double(row.lights);
    row.to_joint_degrees /= double(row.lights);
    rows.push_back(row);
  }
  return rows;
}

}  // namespace

std::vector<PhotographRow> photographs(const std::filesystem::path& data) {
  std::vector<PhotographRow> rows;
  const auto add = [&](std::vector<PhotographRow> more) { rows.insert(rows.end(), more.begin(), more.end()); };
  if (std::filesystem::is_directory(data / "psbox_two_mirror_balls")) {
    add(two_mirror_balls(data / "psbox_two_mirror_balls" / "data"));
  }
  if (std::filesystem::is_directory(data / "diligent_ball16")) add(diligent_ball(data / "diligent_ball16"));
  return rows;
}

}  // namespace lightstage::cli
