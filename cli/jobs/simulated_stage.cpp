#include "cli/jobs/simulated_stage.h"

#include <memory>
#include <utility>

#include "capture/stage.h"

namespace lightstage::cli {

namespace {

sim::World world_of(const SimulatedStageOptions& options) {
  capture::LayoutOptions layout;
  layout.lights = options.lights;
  layout.camera_pixels = options.pixels;
  sim::Simulation simulation;
  simulation.stage = capture::make_stage("simulated", layout);
  simulation.motion = {.amplitude_m = 0, .rotation_degrees = 0};
  simulation.subject.seed = options.seed;
  simulation.subject.yaw_degrees = 20;
  if (!options.mesh.empty()) {
    simulation.subject.kind = sim::SubjectKind::kMesh;
    simulation.subject.mesh_path = options.mesh.string();
  }
  return sim::World(simulation);
}

core::OlatScan scan_of(const sim::World& world) {
  const capture::Stage& stage = world.simulation().stage;
  const core::CameraModel& camera = stage.cameras.front().model;
  const std::vector<core::Light> lights = capture::nominal_lights(stage);
  std::vector<core::Direction> directions;
  for (const core::Light& light : lights) directions.push_back(light.direction);
  auto images = std::make_shared<const std::vector<core::Image>>(world.render_directions(camera, directions, 0));
  const core::Image& first = images->front();
  const core::ImageSize size{first.height(), first.width(), 3};
  return core::OlatScan("simulated", lights, size, world.coverage(camera, 0),
                        [images](std::size_t light) { return (*images)[light]; });
}

}  // namespace

SimulatedStage::SimulatedStage(const SimulatedStageOptions& options)
    : world_(world_of(options)), scan_(scan_of(world_)) {}

std::vector<core::Image> SimulatedStage::truth(std::span<const core::Direction> directions) const {
  return world_.render_directions(world_.simulation().stage.cameras.front().model, directions, 0);
}

}  // namespace lightstage::cli
