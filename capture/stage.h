// A light stage as it was built: where lights and cameras are meant to be. What calibration finds is stored
// elsewhere.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "capture/hardware.h"
#include "capture/light_limits.h"
#include "core/camera_model.h"
#include "core/light_list.h"
#include "core/vec3.h"

namespace lightstage::capture {

struct StageCamera {
  std::string name;
  core::CameraModel model;
  // Sensor full-scales per second of exposure for unit radiance: radiance = signal / (responsivity * exposure
  // seconds).
  double responsivity = 1;
};

// How a simulated stage differs from the drawing; read by the simulator alone.
struct StageSimulation {
  std::uint64_t seed = 1;
  double mount_error_degrees = 0;  // standard deviation of each light's direction error
  double gain_spread = 0;          // standard deviation of the logarithm of each light's colour gains
  double led_radius_m = 0.012;     // radius of the emitting disc
  std::vector<int> dead_lights;
};

struct Stage {
  std::string name;
  double radius_m = 1.5;                    // nominal distance of the lights from the centre
  std::vector<core::Vec3> light_positions;  // metres, stage frame
  std::vector<StageCamera> cameras;         // at least one; the first is the primary one
  LightLimits limits;
  Hardware hardware;  // empty for a stage that is only drawn
  StageSimulation simulation;
};

enum class Layout { kGeodesic, kFibonacci };

// Lights lie top down, ring by ring. Cameras stand level with the centre at 1.25 radii and look at it; the
// first on +z, the others 30, -30, 60, -60, ... degrees round (positive towards +x). A head of 0.25 m fills
// three quarters of their picture's height, and a white Lambertian surface under one unit light fills 0.9 of
// their scale in 20 ms.
struct LayoutOptions {
  Layout layout = Layout::kGeodesic;
  std::size_t lights = 180;
  double radius_m = 1.5;
  // Real stages have no lights below the subject's stand and where the cameras look in.
  double bottom_hole_degrees = 35;  // half-angle about -y
  double camera_hole_degrees = 6;   // half-angle about each camera's direction
  int camera_pixels = 512;          // width and height of each camera
  int cameras = 1;                  // at most 12
};

// Exactly `lights` lights: the layout is made dense enough that so many lie outside the holes; surplus ones
// nearest to the bottom hole are left out. Throws UsageError for values out of range.
Stage make_stage(const std::string& name, const LayoutOptions& options);
// Lights in the directions of an .lp file, all of them in the file's order, at radius_m; cameras as in
// make_stage; named after the file. Throws BadInput with file and line (core::read_lp).
Stage stage_from_lp(const std::filesystem::path& lp, const LayoutOptions& options);

// TOML, with everything in it; reading what was written gives the same stage bit for bit. Angles in degrees,
// lengths in metres. Reading throws BadInput with file and line: for a missing or misspelt key, a value out
// of range, camera axes that are not orthonormal, two cameras of one name, a light at the centre, a dead
// light that the stage does not have, hardware that could not work on any machine (docs/hardware.md). Writing throws BadInput for names that would not read back.
Stage read_stage(const std::filesystem::path& path);
Stage parse_stage(std::string_view toml, const std::string& source_name);
std::string to_toml(const Stage& stage);
// Its [[camera]] entry alone.
std::string to_toml(const StageCamera& camera);

// Letters, digits, '-', '_' and '.', not starting with '.': for stages and cameras, because both name things
// in the store.
bool valid_stage_name(std::string_view name);

// Names the stage's lights for the store ("NAME-<16 hexadecimal digits>"): scans with one key share
// calibrations. Depends on name, radius, light positions and simulation, not on cameras.
std::string stage_key(const Stage& stage);

// The lights as drawn, with unit gain: what an uncalibrated scan falls back on.
std::vector<core::Light> nominal_lights(const Stage& stage);

}  // namespace lightstage::capture
