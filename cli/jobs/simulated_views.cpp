#include "cli/jobs/simulated_views.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "core/interrupt.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "db/content_hash.h"
#include "sim/sensor.h"
#include "sim/world.h"

namespace lightstage::cli {

namespace {

using core::Direction;
using core::Vec3;

constexpr int kPixels = 128;
constexpr std::size_t kQueries = 64;

// Uniform numbers that are the same with every standard library.
class Dice {
 public:
  Dice(std::uint64_t seed, std::size_t index) : engine_(seed * 0x9E3779B97F4A7C15u + index) { engine_.discard(8); }

  double between(double low, double high) { return low + (high - low) * (double(engine_() >> 11) * 0x1p-53); }
  double log_between(double low, double high) { return std::exp(between(std::log(low), std::log(high))); }
  bool chance(double probability) { return between(0, 1) < probability; }
  std::uint64_t bits() { return engine_(); }

 private:
  std::mt19937_64 engine_;
};

// A rotation about a random axis, by Rodrigues' formula.
std::vector<Direction> turned(const std::vector<Direction>& directions, Dice& dice) {
  const Vec3 axis = core::random_directions(1, dice.bits())[0].vec();
  const double angle = dice.between(0, 2 * std::numbers::pi), c = std::cos(angle), s = std::sin(angle);
  std::vector<Direction> result;
  for (const Direction& direction : directions) {
    const Vec3 v = direction.vec();
    result.push_back(Direction::from_vector(v * c + cross(axis, v) * s + axis * (dot(axis, v) * (1 - c))));
  }
  return result;
}

std::vector<Direction> random_stage(Dice& dice) {
  const auto lights = std::size_t(dice.log_between(48, 332));
  const bool dome = dice.chance(0.2);
  const bool geodesic = dice.chance(0.5);
  // Holes and domes leave a part of the sphere without lights.
  const double share = dome ? 0.5 : 0.9;
  const auto dense = std::size_t(double(lights) / share);
  const double jitter = dice.between(0, 0.15) * std::sqrt(4 * std::numbers::pi / double(dense));
  std::vector<Direction> stage;
  for (const Direction& d :
       turned(geodesic ? core::geodesic_directions(dense) : core::fibonacci_directions(dense), dice)) {
    const Vec3 shift{dice.between(-jitter, jitter), dice.between(-jitter, jitter), dice.between(-jitter, jitter)};
    const Direction light = Direction::from_vector(d.vec() + shift);
    const bool hole =
        light.y() < -std::cos(core::radians_from_degrees(35)) || light.z() > std::cos(core::radians_from_degrees(6));
    if (!hole && !(dome && light.z() < 0)) stage.push_back(light);
  }
  return stage;
}

// Where users ask: within about one spacing of a light; mostly in front of the subject, where the picture is not black.
std::vector<Direction> random_queries(const std::vector<Direction>& stage, Dice& dice) {
  const double reach = 1.2 * core::median_spacing_radians(stage);
  std::vector<Direction> queries;
  for (const Direction& d : core::random_directions(100 * kQueries, dice.bits())) {
    const double nearest = angle_radians(d, stage[core::nearest_indices(stage, d, 1)[0]]);
    if (nearest > reach || nearest < 1e-3) continue;
    if (d.z() < -0.5 && !dice.chance(0.15)) continue;
    queries.push_back(d);
    if (queries.size() == kQueries) break;
  }
  return queries;
}

// Looks at a third of the head or the whole, around a random point of it.
core::CameraModel random_camera(core::CameraModel camera, Dice& dice) {
  const double zoom = dice.log_between(1, 3);
  camera.fx *= zoom;
  camera.fy *= zoom;
  const double reach = (zoom - 1) / 2 * 0.6 * kPixels;
  camera.cx += dice.between(-reach, reach);
  camera.cy += dice.between(-reach, reach);
  return camera;
}

model::TruthView make_view(const SimulatedViewsOptions& options, std::size_t index) {
  Dice dice(options.seed, index);
  const std::vector<Direction> stage = random_stage(dice);
  const std::vector<Direction> queries = random_queries(stage, dice);

  sim::Simulation simulation;
  capture::LayoutOptions layout;
  layout.lights = 1;  // lights are shone where the stage above has them
  layout.camera_pixels = kPixels;
  layout.radius_m = dice.between(1.2, 2.0);
  simulation.stage = capture::make_stage("training", layout);
  simulation.motion = {.amplitude_m = 0, .rotation_degrees = 0};
  if (!options.meshes.empty() && index % 2 == 0) {
    simulation.subject.kind = sim::SubjectKind::kMesh;
    simulation.subject.mesh_path = options.meshes[index / 2 % options.meshes.size()].string();
  }
  simulation.subject.seed = 1 + dice.bits() % 1'000'000;
  simulation.subject.yaw_degrees = dice.between(-60, 60);

  const sim::World world(simulation);
  const core::CameraModel camera = random_camera(simulation.stage.cameras[0].model, dice);
  core::Image mask = world.coverage(camera, 0);
  std::vector<Direction> directions = stage;
  directions.insert(directions.end(), queries.begin(), queries.end());
  std::vector<core::Image> images = world.render_directions(camera, directions, 0);

  // Skin is not the only thing that is scanned: other colours, and grey.
  std::array<double, 3> colour;
  for (double& c : colour) c = dice.log_between(0.5, 2);
  const bool grey = dice.chance(0.15);
  for (core::Image& image : images) {
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x) {
        const float mean = (image(y, x, 0) + image(y, x, 1) + image(y, x, 2)) / 3;
        for (int c = 0; c < 3; ++c) image(y, x, c) = grey ? mean : float(colour[std::size_t(c)]) * image(y, x, c);
      }
    }
  }
  std::vector<core::Image> truth(std::make_move_iterator(images.begin() + std::ptrdiff_t(stage.size())),
                                 std::make_move_iterator(images.end()));
  images.resize(stage.size());

  std::vector<core::Light> lights;
  for (const Direction& direction : stage) lights.push_back({.direction = direction});
  auto captured = std::make_shared<std::vector<core::Image>>(std::move(images));
  const auto scan = [&] {
    return core::OlatScan("training " + std::to_string(index), lights, {kPixels, kPixels, 3}, mask,
                          [captured](std::size_t light) { return (*captured)[light]; });
  };
  if (dice.chance(0.5)) {
    sim::SensorSpec sensor;
    sensor.vignetting = 0;
    sensor.full_well_electrons = dice.log_between(3'000, 30'000);
    constexpr core::Nanoseconds kExposure = 20'000'000;
    // What is shown as 1 fills two thirds of the sensor's range.
    const double responsivity = 0.67 / (scan().exposure() * 1e-9 * double(kExposure));
    for (core::Image& image : *captured) image = sim::sense(image, sensor, responsivity, kExposure, dice.bits());
  }
  return {scan(), queries, std::move(truth)};
}

}  // namespace

model::SimulatedViews simulated_views(const SimulatedViewsOptions& options) {
  nlohmann::json meshes = nlohmann::json::array();
  core::Progress progress("reading meshes", options.meshes.size());
  for (const std::filesystem::path& mesh : options.meshes) {
    core::throw_if_interrupted();
    sim::Simulation simulation;
    simulation.subject = {.kind = sim::SubjectKind::kMesh, .mesh_path = mesh.string()};
    const sim::World readable(simulation);
    progress.advance();
    meshes.push_back({{"file", mesh.filename().string()}, {"hash", db::hash_file(mesh).hex()}});
  }
  const nlohmann::json description{{"views", options.views}, {"seed", options.seed}, {"meshes", meshes}};
  return {options.views, description.dump(), [options](std::size_t index) { return make_view(options, index); }};
}

}  // namespace lightstage::cli
