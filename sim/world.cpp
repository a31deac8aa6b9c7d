#include "sim/world.h"

#include <algorithm>
#include <limits>
#include <mutex>

#include "core/error.h"
#include "core/parallel.h"
#include "sim/held_board.h"
#include "sim/render/illuminate.h"
#include "sim/scene/motion.h"
#include "sim/scene/true_lights.h"
#include "sim/subjects/ball.h"
#include "sim/subjects/chessboard.h"
#include "sim/subjects/head.h"
#include "sim/subjects/mesh_file.h"
#include "sim/subjects/mirror.h"
#include "sim/subjects/white_card.h"

namespace lightstage::sim {
namespace {

// Patterns of more lights than this use interpolated shadows: rays for each would take seconds a frame.
constexpr std::size_t kMostExactLights = 16;

void require(bool good, const std::string& problem) {
  if (!good) throw core::BadInput("simulation: " + problem);
}

// A board is moved to its next pose every second, within a quarter of its height about stage centre.
constexpr core::Nanoseconds kBoardHeld = core::kSecond;
constexpr double kBoardReach = 0.25;

// Before anything is built.
const Simulation& checked(const Simulation& s) {
  const double size = subject_size_m(s.subject);
  require(std::isfinite(size) && size > 0, "the subject's size_m must be positive");
  require(s.subject.albedo >= 0 && s.subject.albedo <= 1, "albedo must be from 0 to 1");
  require(std::isfinite(s.subject.yaw_degrees), "yaw_degrees must be finite");
  require(std::isfinite(s.motion.amplitude_m) && std::isfinite(s.motion.rotation_degrees), "the motion must be finite");
  require(s.stage.simulation.led_radius_m > 0, "led_radius_m must be positive");
  require(std::isfinite(s.stage.radius_m) && s.stage.radius_m > size, "the subject does not fit into the stage");
  require(std::isfinite(norm(s.subject.position)) && norm(s.subject.position) + size < s.stage.radius_m,
          "the subject must stand within the stage");
  return s;
}

std::unique_ptr<Subject> make_subject(const SubjectSpec& spec) {
  const double size = subject_size_m(spec);
  switch (spec.kind) {
    case SubjectKind::kProceduralHead:
      return make_head(spec.seed, size);
    case SubjectKind::kMesh:
      return load_mesh(spec.mesh_path, spec.mesh_hash, size, spec.seed);
    case SubjectKind::kMirrorBall:
      return std::make_unique<Ball>(size, kMirrorDust);
    case SubjectKind::kGreyBall:
      return std::make_unique<Ball>(size, spec.albedo);
    case SubjectKind::kChessboard:
      return make_chessboard(size);
    case SubjectKind::kWhiteCard:
      return make_white_card(size);
  }
  throw core::BadInput("simulation: unknown kind of subject");
}

// Only what breathes moves by itself; balls stand on a tripod, and a board is held still in one pose after another.
MotionSpec motion_of(const Simulation& simulation) {
  const SubjectKind kind = simulation.subject.kind;
  const bool alive = kind == SubjectKind::kProceduralHead || kind == SubjectKind::kMesh;
  return alive ? simulation.motion : MotionSpec{.amplitude_m = 0, .rotation_degrees = 0};
}

int samples_per_side(const Simulation& simulation) {
  const int side = int(std::lround(std::sqrt(std::max(simulation.pixel_samples, 0))));
  require(
      side >= 1 && side <= 16 && side * side == simulation.pixel_samples,
      "pixel_samples is " + std::to_string(simulation.pixel_samples) + "; it must be a square number from 1 to 256");
  return side;
}

}  // namespace

struct World::Impl {
  explicit Impl(const Simulation& s)
      : simulation(checked(s)),
        lights(sim::true_lights(s.stage)),
        motion(motion_of(s), s.subject, s.seed),
        subject(make_subject(s.subject)),
        surfaces(*subject, samples_per_side(s), s.indirect_bounce, s.stage.cameras.size()) {}

  core::Vec3 light_position(std::size_t i) const { return *lights[i].position; }

  core::RigidTransform stage_from_subject(core::Nanoseconds t) const {
    const bool held = simulation.subject.kind == SubjectKind::kChessboard && simulation.motion.amplitude_m != 0;
    if (!held) return motion.stage_from_subject(t);
    return held_board_pose(simulation.seed, int(t / kBoardHeld), kBoardReach * subject_size_m(simulation.subject));
  }

  void prepare_visibility() {
    const core::RigidTransform subject_from_stage = motion.rest().inverse();
    std::vector<Vec3f> positions;
    for (const core::Light& light : lights) positions.emplace_back(subject_from_stage.apply(*light.position));
    subject->prepare_visibility(positions);
  }

  // What a mirror adds to the light that its surface scatters.
  void add_mirrored(core::Image& image, const SurfaceBuffer& buffer, const core::CameraModel& camera,
                    std::span<const Lamp> lamps) const {
    std::array<double, 3> room{};
    for (const Lamp& lamp : lamps) {
      for (std::size_t c = 0; c < 3; ++c) room[c] += kMirrorReflectance * kRoomRadiance * lamp.gain[c];
    }
    const core::Image covered = sim::coverage(buffer);
    for (std::size_t i = 0; i < covered.values().size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c) image.values()[i * 3 + c] += float(room[c]) * covered.values()[i];
    }
    // In the ball's frame, where the lamps keep their light at stage centre.
    const core::Vec3 place = simulation.subject.position;
    core::CameraModel moved_camera = camera;
    moved_camera.stage_from_camera.translation = camera.stage_from_camera.translation - place;
    std::vector<Lamp> moved(lamps.begin(), lamps.end());
    for (Lamp& lamp : moved) {
      const double squared = dot(lamp.position, lamp.position);
      lamp.position = lamp.position - place;
      for (double& gain : lamp.gain) gain *= squared / dot(lamp.position, lamp.position);
    }
    add_reflections(image, moved_camera, subject_size_m(simulation.subject), moved);
  }

  // The picture under lamps of the stage frame; `index` names them in the stage, -1 where they are not of it.
  core::Image picture(const core::CameraModel& camera, const core::RigidTransform& stage_from_subject,
                      const SurfaceBuffer& buffer, std::span<const Lamp> lamps, std::span<const int> index) const {
    const core::RigidTransform subject_from_stage = stage_from_subject.inverse();
    LightSet set;
    for (std::size_t i = 0; i < lamps.size(); ++i) {
      set.add(Vec3f(subject_from_stage.apply(lamps[i].position)), core::norm(lamps[i].position), lamps[i].gain,
              index[i]);
    }
    const Shadows shadows = lamps.size() > kMostExactLights ? Shadows::kInterpolated : Shadows::kExact;
    core::Image image = illuminate(*subject, buffer, set, shadows);
    if (simulation.subject.kind == SubjectKind::kMirrorBall) add_mirrored(image, buffer, camera, lamps);
    return image;
  }

  Simulation simulation;
  std::vector<core::Light> lights;
  Motion motion;
  std::unique_ptr<Subject> subject;
  SurfaceCache surfaces;
  std::once_flag visibility_prepared;
};

World::World(const Simulation& simulation) : impl_(std::make_unique<Impl>(simulation)) {}
World::~World() = default;
World::World(World&&) noexcept = default;

const Simulation& World::simulation() const {
  return impl_->simulation;
}
const std::vector<core::Light>& World::true_lights() const {
  return impl_->lights;
}

core::Image World::render(const core::CameraModel& camera, std::span<const capture::LightLevel> levels,
                          core::Nanoseconds t) const {
  std::vector<Lamp> lamps;
  std::vector<int> index;
  for (const capture::LightLevel& level : levels) {
    if (level.light_index < 0 || std::size_t(level.light_index) >= impl_->lights.size()) {
      throw core::BadInput("simulation: light " + std::to_string(level.light_index) + " is lit, but there are " +
                           std::to_string(impl_->lights.size()) + " lights");
    }
    const core::Light& light = impl_->lights[std::size_t(level.light_index)];
    const std::array<double, 3> gain{light.gain[0] * double(level.r), light.gain[1] * double(level.g),
                                     light.gain[2] * double(level.b)};
    if (gain == std::array<double, 3>{}) continue;
    lamps.push_back({*light.position, impl_->simulation.stage.simulation.led_radius_m, gain});
    index.push_back(level.light_index);
  }
  if (lamps.size() > kMostExactLights) {
    std::call_once(impl_->visibility_prepared, [this] { impl_->prepare_visibility(); });
  }
  const core::RigidTransform pose = impl_->stage_from_subject(t);
  return impl_->picture(camera, pose, *impl_->surfaces.get(camera, pose), lamps, index);
}

std::vector<core::Image> World::render_directions(const core::CameraModel& camera,
                                                  std::span<const core::Direction> directions,
                                                  core::Nanoseconds t) const {
  const core::RigidTransform pose = impl_->stage_from_subject(t);
  const auto buffer = impl_->surfaces.get(camera, pose);
  const capture::Stage& stage = impl_->simulation.stage;
  std::vector<core::Image> images;
  images.reserve(directions.size());
  for (const core::Direction& direction : directions) {
    const Lamp lamp{direction.vec() * stage.radius_m, stage.simulation.led_radius_m, {1, 1, 1}};
    images.push_back(impl_->picture(camera, pose, *buffer, {&lamp, 1}, std::array{-1}));
  }
  return images;
}

core::Image World::coverage(const core::CameraModel& camera, core::Nanoseconds t) const {
  return sim::coverage(*impl_->surfaces.get(camera, impl_->stage_from_subject(t)));
}

core::Image World::true_flow(const core::CameraModel& camera, core::Nanoseconds from, core::Nanoseconds to) const {
  const core::RigidTransform then = impl_->stage_from_subject(from), later = impl_->stage_from_subject(to);
  const core::RigidTransform back = then.inverse();
  core::Image flow(camera.height, camera.width, 2);
  std::fill(flow.values().begin(), flow.values().end(), std::numeric_limits<float>::quiet_NaN());
  core::parallel_for(std::size_t(camera.height), 8, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const core::Vec3 ray = back.rotation * camera.ray({double(x), double(y)});
        const auto seen = impl_->subject->sample(back.apply(camera.centre()), ray);
        if (!seen) continue;
        const auto start = camera.project(then.apply(to_double(seen->position)));
        const auto end = camera.project(later.apply(to_double(seen->position)));
        if (!start || !end) continue;
        flow(int(y), x, 0) = float(end->x - start->x);
        flow(int(y), x, 1) = float(end->y - start->y);
      }
    }
  });
  return flow;
}

}  // namespace lightstage::sim
