// Stage files: TOML out and in.
#include <set>

#include "capture/stage.h"
#include "capture/toml/hardware.h"
#include "capture/toml/number.h"
#include "core/config.h"
#include "core/error.h"

namespace lightstage::capture {

namespace {

// How far the axes of a camera in a file may be from orthonormal: hand-typed ones are given with a few
// digits.
constexpr double kAxisTolerance = 1e-6;

// Each is compared with all others.
constexpr std::size_t kMostCameras = 256, kMostControllers = 256;
constexpr std::size_t kMostLights = 100'000;

std::string list(std::initializer_list<double> values) {
  std::string text = "[";
  for (const double value : values) text += (text.size() > 1 ? ", " : "") + toml_number(value);
  return text + "]";
}
std::string list(core::Vec3 v) {
  return list({v.x, v.y, v.z});
}

// Camera axes written in the stage frame are the columns of stage_from_camera's rotation.
core::Vec3 column(const core::Mat3& m, double core::Vec3::*axis) {
  return {m.rows[0].*axis, m.rows[1].*axis, m.rows[2].*axis};
}

// What would not read back is not written.
void require_writable_name(const std::string& name) {
  if (!valid_stage_name(name)) {
    throw core::BadInput("'" + name + "' cannot name a stage or camera: use letters, digits, '-', '_' and '.'");
  }
}

void append_simulation(std::string& text, const StageSimulation& simulation) {
  text +=
      "\n# How the simulated stage differs from the drawing; no other program part reads "
      "this.\n[simulation]\n";
  // TOML integers are signed: the upper half of the seeds is written as negative numbers.
  text += "seed = " + std::to_string(static_cast<std::int64_t>(simulation.seed)) + "\n";
  text += "mount_error_degrees = " + toml_number(simulation.mount_error_degrees) + "\n";
  text += "gain_spread = " + toml_number(simulation.gain_spread) + "\n";
  text += "led_radius_m = " + toml_number(simulation.led_radius_m) + "\n";
  text += "dead_lights = [";
  for (std::size_t i = 0; i < simulation.dead_lights.size(); ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(simulation.dead_lights[i]);
  }
  text += "]\n";
}

void append_limits(std::string& text, const LightLimits& limits) {
  text +=
      "\n# What the lights may do. Flashes: at most so many a second as the band begins with, counted from so small a "
      "share of full\n"
      "# light on, over so large a share of the lights. Heat: share of the time, and seconds without a break (0: "
      "any).\n[limits]\n";
  text += "strobe_band_hz = " + list({limits.strobe_from_hz, limits.strobe_to_hz}) + "\n";
  text += "strobe_share = " + toml_number(limits.strobe_share) + "\n";
  text += "strobe_area = " + toml_number(limits.strobe_area) + "\n";
  text += "duty = " + toml_number(limits.duty) + "\n";
  text += "duty_window_s = " + toml_number(limits.duty_window_s) + "\n";
  text += "on_time_s = " + toml_number(limits.on_time_s) + "\n";
}

double positive(const core::TomlTable& table, std::string_view key) {
  const double value = table.number(key);
  if (value <= 0) table.fail(key, "must be above 0");
  return value;
}

double not_negative(const core::TomlTable& table, std::string_view key, double default_value) {
  const double value = table.number(key, default_value);
  if (value < 0) table.fail(key, "must not be negative");
  return value;
}

int pixel_count(const core::TomlTable& table, std::string_view key) {
  const std::int64_t value = table.integer(key);
  if (value < 1 || value > 65536) table.fail(key, "must be 1 to 65536");
  return static_cast<int>(value);
}

core::Vec3 vector(const core::TomlTable& table, std::string_view key) {
  const std::vector<double> v = table.numbers(key, 3);
  return {v[0], v[1], v[2]};
}

std::string name(const core::TomlTable& table) {
  std::string text = table.string("name");
  if (!valid_stage_name(text)) table.fail("name", "must be made of letters, digits, '-', '_' and '.'");
  return text;
}

core::Vec3 unit_vector(const core::TomlTable& table, std::string_view key) {
  const core::Vec3 v = vector(table, key);
  if (std::abs(norm(v) - 1) > kAxisTolerance) table.fail(key, "is not a unit vector");
  return v;
}

core::Mat3 rotation(const core::TomlTable& table) {
  const core::Vec3 right = unit_vector(table, "right"), down = unit_vector(table, "down");
  const core::Vec3 forward = unit_vector(table, "forward");
  if (norm(cross(right, down) - forward) > kAxisTolerance) table.fail("forward", "is not right x down");
  return core::Mat3{{right, down, forward}}.transposed();
}

StageCamera read_camera(const core::TomlTable& table) {
  StageCamera camera;
  camera.name = name(table);
  core::CameraModel& m = camera.model;
  m.width = pixel_count(table, "width_pixels");
  m.height = pixel_count(table, "height_pixels");
  const std::vector<double> focal = table.numbers("focal_length_pixels", 2);
  if (focal[0] <= 0 || focal[1] <= 0) table.fail("focal_length_pixels", "must be above 0");
  m.fx = focal[0];
  m.fy = focal[1];
  const std::vector<double> principal = table.numbers("principal_point_pixels", 2);
  m.cx = principal[0];
  m.cy = principal[1];
  const std::vector<double> radial = table.numbers("radial_distortion", 3);
  m.k1 = radial[0];
  m.k2 = radial[1];
  m.k3 = radial[2];
  const std::vector<double> tangential = table.numbers("tangential_distortion", 2);
  m.p1 = tangential[0];
  m.p2 = tangential[1];
  m.stage_from_camera = {rotation(table), vector(table, "position_m")};
  camera.responsivity = positive(table, "responsivity_per_s");
  return camera;
}

std::vector<int> read_dead_lights(const core::TomlTable& table, std::size_t light_count) {
  std::vector<int> dead;
  if (!table.has("dead_lights")) return dead;
  for (const double light : table.numbers("dead_lights")) {
    if (light != std::floor(light) || light < 0 || light >= double(light_count)) {
      table.fail("dead_lights", "must hold indices of the stage's " + std::to_string(light_count) + " lights, from 0");
    }
    dead.push_back(static_cast<int>(light));
  }
  return dead;
}

StageSimulation read_simulation(const core::TomlTable& table, std::size_t light_count) {
  StageSimulation simulation;
  simulation.seed = static_cast<std::uint64_t>(table.integer("seed", static_cast<std::int64_t>(simulation.seed)));
  simulation.mount_error_degrees = not_negative(table, "mount_error_degrees", simulation.mount_error_degrees);
  simulation.gain_spread = not_negative(table, "gain_spread", simulation.gain_spread);
  simulation.led_radius_m = not_negative(table, "led_radius_m", simulation.led_radius_m);
  simulation.dead_lights = read_dead_lights(table, light_count);
  return simulation;
}

double within(const core::TomlTable& table, std::string_view key, double default_value, double least, double most) {
  const double value = table.number(key, default_value);
  if (!(value >= least && value <= most)) {
    table.fail(key, "must be " + toml_number(least) + " to " + toml_number(most));
  }
  return value;
}

LightLimits read_limits(const core::TomlTable& table) {
  LightLimits limits;
  if (table.has("strobe_band_hz")) {
    const std::vector<double> band = table.numbers("strobe_band_hz", 2);
    if (!(band[0] >= 1 && band[0] < band[1] && band[1] <= 1000)) {
      table.fail("strobe_band_hz", "must be two rising numbers from 1 to 1000");
    }
    limits.strobe_from_hz = band[0];
    limits.strobe_to_hz = band[1];
  }
  limits.strobe_share = within(table, "strobe_share", limits.strobe_share, 0.001, 1);
  limits.strobe_area = within(table, "strobe_area", limits.strobe_area, 0.001, 1);
  limits.duty = within(table, "duty", limits.duty, 0.001, 1);
  limits.duty_window_s = within(table, "duty_window_s", limits.duty_window_s, 0.001, 86400);
  limits.on_time_s = within(table, "on_time_s", limits.on_time_s, 0, 86400);
  return limits;
}

void require_at_most(const core::TomlTable& table, const std::string& key, std::size_t count, std::size_t most) {
  if (count > most)
    table.fail(key, "comes " + std::to_string(count) + " times; a stage has at most " + std::to_string(most));
}

Stage read_table(const core::TomlTable& table) {
  Stage stage;
  stage.name = name(table);
  stage.radius_m = positive(table, "radius_m");
  std::set<std::string> names;
  const std::vector<core::TomlTable> cameras = table.tables("camera"), lights = table.tables("light");
  require_at_most(table, "camera", cameras.size(), kMostCameras);
  require_at_most(table, "controller", table.tables("controller").size(), kMostControllers);
  require_at_most(table, "light", lights.size(), kMostLights);
  for (const core::TomlTable& entry : cameras) {
    stage.cameras.push_back(read_camera(entry));
    if (!names.insert(stage.cameras.back().name).second) entry.fail("name", "is another camera's already");
  }
  for (const core::TomlTable& entry : lights) {
    const core::Vec3 position = vector(entry, "position_m");
    if (norm(position) == 0) entry.fail("position_m", "is the stage centre: a light there has no direction");
    stage.light_positions.push_back(position);
  }
  if (const auto limits = table.optional_table("limits")) stage.limits = read_limits(*limits);
  if (const auto simulation = table.optional_table("simulation")) {
    stage.simulation = read_simulation(*simulation, stage.light_positions.size());
  }
  stage.hardware = read_hardware(table);
  table.finish();
  if (stage.cameras.empty()) table.fail("camera", "is missing: a stage needs at least one [[camera]]");
  if (stage.light_positions.empty()) table.fail("light", "is missing: a stage needs at least one [[light]]");
  return stage;
}

}  // namespace

std::string to_toml(const StageCamera& camera) {
  require_writable_name(camera.name);
  const core::CameraModel& m = camera.model;
  const core::Mat3& rotation = m.stage_from_camera.rotation;
  std::string text = "\n[[camera]]\n";
  text += "name = \"" + camera.name + "\"\n";
  text += "width_pixels = " + std::to_string(m.width) + "\n";
  text += "height_pixels = " + std::to_string(m.height) + "\n";
  text += "focal_length_pixels = " + list({m.fx, m.fy}) + "\n";
  text += "principal_point_pixels = " + list({m.cx, m.cy}) + "\n";
  text += "radial_distortion = " + list({m.k1, m.k2, m.k3}) + "\n";
  text += "tangential_distortion = " + list({m.p1, m.p2}) + "\n";
  text += "position_m = " + list(m.centre()) + "\n";
  text += "right = " + list(column(rotation, &core::Vec3::x)) + "\n";
  text += "down = " + list(column(rotation, &core::Vec3::y)) + "\n";
  text += "forward = " + list(column(rotation, &core::Vec3::z)) + "\n";
  text += "responsivity_per_s = " + toml_number(camera.responsivity) + "\n";
  return text;
}

std::string to_toml(const Stage& stage) {
  require_writable_name(stage.name);
  std::string text =
      "# A light stage as drawn. Stage frame: right-handed, metres, origin at stage centre, x right, y up,\n"
      "# z towards the primary (first) camera. Camera axes (right, down, forward) are unit vectors in that "
      "frame.\n";
  text += "name = \"" + stage.name + "\"\n";
  text += "radius_m = " + toml_number(stage.radius_m) + "\n";
  append_limits(text, stage.limits);
  text += controllers_and_lines_toml(stage.hardware);
  for (std::size_t i = 0; i < stage.cameras.size(); ++i) {
    text += to_toml(stage.cameras[i]);
    if (!stage.hardware.cameras.empty()) text += device_toml(stage.hardware.cameras.at(i));
  }
  append_simulation(text, stage.simulation);
  text += "\n# Lights, counted from 0.\n";
  for (std::size_t i = 0; i < stage.light_positions.size(); ++i) {
    text += "[[light]]  # " + std::to_string(i) + "\nposition_m = " + list(stage.light_positions[i]) + "\n";
    if (!stage.hardware.wiring.empty()) text += wiring_toml(stage.hardware.wiring.at(i));
  }
  return text;
}

Stage parse_stage(std::string_view toml, const std::string& source_name) {
  return read_table(core::TomlTable::parse(toml, source_name));
}

Stage read_stage(const std::filesystem::path& path) {
  return read_table(core::TomlTable::read_file(path));
}

}  // namespace lightstage::capture
