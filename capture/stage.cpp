#include "capture/stage.h"

#include <algorithm>
#include <bit>
#include <cctype>

#include "core/direction.h"
#include "core/error.h"
#include "core/sphere.h"
#include "db/content_hash.h"

namespace lightstage::capture {

namespace {

// A head of this height fills this share of the picture's height.
constexpr double kHeadHeightM = 0.25;
constexpr double kHeadShare = 0.75;
// Cameras look in through gaps between the lights, from just outside.
constexpr double kCameraDistanceInRadii = 1.25;
constexpr double kCameraAzimuthStepDegrees = 30;
constexpr int kMaxCameras = 12;  // a full circle of them
constexpr double kRadialDistortion = -0.08;
// A white Lambertian surface under one unit light (radiance 1) fills 0.9 of the scale in 20 ms.
constexpr double kResponsivity = 0.9 / 0.020;
constexpr std::size_t kMaxLights = 10000;

void require(bool condition, const std::string& message) {
  if (!condition) throw core::UsageError("stage layout: " + message);
}

void check_cameras_and_radius(const LayoutOptions& options) {
  require(options.radius_m >= 0.1 && options.radius_m <= 100, "the radius must be 0.1 to 100 m");
  require(options.camera_pixels >= 8 && options.camera_pixels <= 16384, "a camera needs 8 to 16384 pixels a side");
  require(options.cameras >= 1 && options.cameras <= kMaxCameras,
          "1 to " + std::to_string(kMaxCameras) + " cameras can be placed");
}

void check(const LayoutOptions& options) {
  check_cameras_and_radius(options);
  require(options.lights >= 1 && options.lights <= kMaxLights, "1 to " + std::to_string(kMaxLights) + " lights");
  require(options.bottom_hole_degrees >= 0 && options.bottom_hole_degrees <= 150,
          "the bottom hole's half-angle must be 0 to 150 degrees");
  require(options.camera_hole_degrees >= 0 && options.camera_hole_degrees <= 45,
          "a camera hole's half-angle must be 0 to 45 degrees");
}

// The letters that a stage's name may have are those of a scan's.
bool good_name_character(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '_' || c == '.';
}

// Camera 0 looks along -z; the others stand to its right and left in turn, 30 degrees further each time.
double camera_azimuth_degrees(int camera_index) {
  const int rank = (camera_index + 1) / 2;
  return (camera_index % 2 == 1 ? 1 : -1) * rank * kCameraAzimuthStepDegrees;
}

std::vector<StageCamera> place_cameras(const LayoutOptions& options) {
  const double distance = kCameraDistanceInRadii * options.radius_m;
  const double field_of_view = 2 * core::degrees_from_radians(std::atan(kHeadHeightM / kHeadShare / 2 / distance));
  std::vector<StageCamera> cameras;
  for (int i = 0; i < options.cameras; ++i) {
    const double azimuth = core::radians_from_degrees(camera_azimuth_degrees(i));
    const core::Vec3 position = distance * core::Vec3{std::sin(azimuth), 0, std::cos(azimuth)};
    StageCamera camera{"cam" + std::to_string(i),
                       core::look_at(position, {0, 0, 0}, options.camera_pixels, options.camera_pixels, field_of_view),
                       kResponsivity};
    camera.model.k1 = kRadialDistortion;
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

std::vector<core::Direction> outside_holes(const std::vector<core::Direction>& directions,
                                           const std::vector<StageCamera>& cameras, const LayoutOptions& options) {
  const core::Direction down = core::Direction::from_vector({0, -1, 0});
  const auto in_hole = [&](const core::Direction& d) {
    if (core::angle_radians(d, down) < core::radians_from_degrees(options.bottom_hole_degrees)) return true;
    return std::any_of(cameras.begin(), cameras.end(), [&](const StageCamera& camera) {
      const auto towards_camera = core::Direction::from_vector(camera.model.centre());
      return core::angle_radians(d, towards_camera) < core::radians_from_degrees(options.camera_hole_degrees);
    });
  };
  std::vector<core::Direction> kept;
  std::remove_copy_if(directions.begin(), directions.end(), std::back_inserter(kept), in_hole);
  return kept;
}

// Rings from the top down. Heights that differ by rounding alone count as one ring.
void sort_top_down(std::vector<core::Direction>& directions) {
  const auto ring = [](const core::Direction& d) { return std::llround(d.y() * 1e9); };
  std::stable_sort(directions.begin(), directions.end(), [&](const core::Direction& a, const core::Direction& b) {
    if (ring(a) != ring(b)) return ring(a) > ring(b);
    return a.longitude_degrees() < b.longitude_degrees();
  });
}

std::vector<core::Direction> place_lights(const std::vector<StageCamera>& cameras, const LayoutOptions& options) {
  const std::size_t give_up_at = 100 * options.lights + 10000;
  for (std::size_t asked = options.lights; asked <= give_up_at;) {
    const std::vector<core::Direction> all =
        options.layout == Layout::kGeodesic ? core::geodesic_directions(asked) : core::fibonacci_directions(asked);
    std::vector<core::Direction> kept = outside_holes(all, cameras, options);
    if (kept.size() >= options.lights) {
      sort_top_down(kept);
      kept.resize(options.lights);
      return kept;
    }
    // One more point on the sphere adds at most about one outside the holes, so this does not overshoot.
    asked = options.layout == Layout::kGeodesic ? all.size() + 1 : asked + (options.lights - kept.size());
  }
  throw core::UsageError("stage layout: the holes leave no room for " + std::to_string(options.lights) +
                         " lights; make them smaller");
}

// Doubles are hashed by their bits: what reads back from a stage file has the same key.
void append(std::vector<std::uint8_t>& bytes, std::uint64_t word) {
  for (int shift = 0; shift < 64; shift += 8) bytes.push_back(static_cast<std::uint8_t>(word >> shift));
}
void append(std::vector<std::uint8_t>& bytes, double value) {
  append(bytes, std::bit_cast<std::uint64_t>(value));
}

}  // namespace

bool valid_stage_name(std::string_view name) {
  return !name.empty() && name.front() != '.' && std::all_of(name.begin(), name.end(), good_name_character);
}

Stage make_stage(const std::string& name, const LayoutOptions& options) {
  check(options);
  require(valid_stage_name(name), "the name '" + name + "' must be made of letters, digits, '-', '_' and '.'");
  Stage stage;
  stage.name = name;
  stage.radius_m = options.radius_m;
  stage.cameras = place_cameras(options);
  for (const core::Direction& direction : place_lights(stage.cameras, options)) {
    stage.light_positions.push_back(options.radius_m * direction.vec());
  }
  return stage;
}

Stage stage_from_lp(const std::filesystem::path& lp, const LayoutOptions& options) {
  check_cameras_and_radius(options);
  Stage stage;
  stage.name = lp.stem().string();
  std::replace_if(
      stage.name.begin(), stage.name.end(), [](char c) { return !good_name_character(c); }, '-');
  if (!valid_stage_name(stage.name)) stage.name = "lp";
  stage.radius_m = options.radius_m;
  stage.cameras = place_cameras(options);
  for (const core::LpEntry& entry : core::read_lp(lp)) {
    stage.light_positions.push_back(options.radius_m * entry.direction.vec());
  }
  if (stage.light_positions.empty()) throw core::BadInput(lp.string() + ": no lights");
  return stage;
}

std::string stage_key(const Stage& stage) {
  std::vector<std::uint8_t> bytes;
  append(bytes, stage.radius_m);
  append(bytes, stage.light_positions.size());
  for (const core::Vec3& p : stage.light_positions) {
    append(bytes, p.x);
    append(bytes, p.y);
    append(bytes, p.z);
  }
  const StageSimulation& s = stage.simulation;
  append(bytes, s.seed);
  append(bytes, s.mount_error_degrees);
  append(bytes, s.gain_spread);
  append(bytes, s.led_radius_m);
  for (const int light : s.dead_lights) append(bytes, static_cast<std::uint64_t>(light));
  return stage.name + "-" + db::hash_bytes(bytes).hex().substr(0, 16);
}

std::vector<core::Light> nominal_lights(const Stage& stage) {
  std::vector<core::Light> lights;
  for (const core::Vec3& position : stage.light_positions) {
    lights.push_back({core::Direction::from_vector(position), position, {1, 1, 1}});
  }
  return lights;
}

}  // namespace lightstage::capture
