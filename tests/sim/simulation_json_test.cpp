#include <catch2/catch.hpp>
#include <limits>

#include "core/camera_model.h"
#include "core/error.h"
#include "sim/simulation.h"

using namespace lightstage;
using Catch::Matchers::Contains;

namespace {

// Every field away from its default, and numbers that need all their digits.
sim::Simulation unusual() {
  sim::Simulation s;
  s.stage.name = "tower-7_b.2";
  s.stage.radius_m = 1.0 / 3;
  s.stage.light_positions = {{0.1, -1.5, 2.0 / 3}, {1e-300, 1, 0}};
  s.stage.cameras.push_back({"front", core::look_at({0.1, 0.2, 1.9}, {0, 0, 0}, 31, 17, 9.1), 0.7});
  s.stage.cameras[0].model.k1 = -0.123456789012345;
  s.stage.simulation = {
      .seed = 3, .mount_error_degrees = 0.3, .gain_spread = 0.1, .led_radius_m = 0.02, .dead_lights = {1}};
  s.subject = {.kind = sim::SubjectKind::kMesh,
               .seed = std::numeric_limits<std::uint64_t>::max(),
               .mesh_path = "/scans/\xC3\xA9t\xC3\xA9/a \"b\".ply",
               .mesh_hash = "00ff",
               .size_m = 0.1 + 0.2,
               .albedo = 1.0 / 7,
               .yaw_degrees = -12.5,
               .position = {0.1, -1.0 / 3, 0}};
  s.motion = {.amplitude_m = 1e-17, .rotation_degrees = 0.1};
  s.sensor = {.noise = false,
              .full_well_electrons = 1e5,
              .read_noise_electrons = 0.3,
              .bits = 14,
              .vignetting = 0.01,
              .bayer = true};
  s.faults = {.drop_exposures = {1, 2},
              .duplicate_exposures = {3},
              .damage_exposures = {4, 5, 6},
              .light_timeouts = {7},
              .drop_probability = 0.03,
              .rise_time = 9'007'199'254'740'993,  // not a float64
              .trigger_jitter = -5};
  s.indirect_bounce = true;
  s.pixel_samples = 9;
  s.seed = 0x8000000000000001u;
  return s;
}

std::string with(std::string json, const std::string& from, const std::string& to) {
  const std::size_t at = json.find(from);
  REQUIRE(at != std::string::npos);
  return json.replace(at, from.size(), to);
}

}  // namespace

TEST_CASE("a simulation survives JSON in every field") {
  const sim::Simulation before = unusual();
  const sim::Simulation after = sim::simulation_from_json(sim::to_json(before));
  CHECK(sim::to_json(after) == sim::to_json(before));
  CHECK(after.subject.kind == before.subject.kind);
  CHECK(after.subject.seed == before.subject.seed);
  CHECK(after.subject.mesh_path == before.subject.mesh_path);
  CHECK(after.subject.mesh_hash == before.subject.mesh_hash);
  CHECK(after.subject.size_m == before.subject.size_m);
  CHECK(after.subject.albedo == before.subject.albedo);
  CHECK(after.subject.yaw_degrees == before.subject.yaw_degrees);
  CHECK(after.subject.position == before.subject.position);
  CHECK(after.motion.amplitude_m == before.motion.amplitude_m);
  CHECK(after.motion.rotation_degrees == before.motion.rotation_degrees);
  CHECK(after.sensor.noise == before.sensor.noise);
  CHECK(after.sensor.full_well_electrons == before.sensor.full_well_electrons);
  CHECK(after.sensor.read_noise_electrons == before.sensor.read_noise_electrons);
  CHECK(after.sensor.bits == before.sensor.bits);
  CHECK(after.sensor.vignetting == before.sensor.vignetting);
  CHECK(after.sensor.bayer == before.sensor.bayer);
  CHECK(after.faults.drop_exposures == before.faults.drop_exposures);
  CHECK(after.faults.duplicate_exposures == before.faults.duplicate_exposures);
  CHECK(after.faults.damage_exposures == before.faults.damage_exposures);
  CHECK(after.faults.light_timeouts == before.faults.light_timeouts);
  CHECK(after.faults.drop_probability == before.faults.drop_probability);
  CHECK(after.faults.rise_time == before.faults.rise_time);
  CHECK(after.faults.trigger_jitter == before.faults.trigger_jitter);
  CHECK(after.indirect_bounce == before.indirect_bounce);
  CHECK(after.pixel_samples == before.pixel_samples);
  CHECK(after.seed == before.seed);
  CHECK(after.stage.light_positions == before.stage.light_positions);
  CHECK(after.stage.radius_m == before.stage.radius_m);
  CHECK(after.stage.cameras.at(0).model.k1 == before.stage.cameras[0].model.k1);
  CHECK(after.stage.simulation.dead_lights == before.stage.simulation.dead_lights);
}

TEST_CASE("simulation JSON that is not right is refused with the key's name") {
  const std::string good = sim::to_json(unusual());
  const auto refused = [](const std::string& json, const std::string& part) {
    INFO(part);
    CHECK_THROWS_MATCHES(sim::simulation_from_json(json), core::BadInput,
                         Catch::Matchers::Predicate<core::BadInput>(
                             [&](const auto& e) { return std::string(e.what()).find(part) != std::string::npos; }));
  };
  refused("", "not valid JSON");
  refused(good.substr(0, good.size() / 2), "not valid JSON");
  refused("[1]", "simulation");
  refused(with(good, "\"albedo\"", "\"albedos\""), "albedo");
  refused(with(good, "\"bits\": 14", "\"bits\": 14.5"), "bits");
  refused(with(good, "\"bits\": 14", "\"bits\": 99999999999"), "bits");
  refused(with(good, "\"noise\": false", "\"noise\": 0"), "noise");
  refused(with(good, "\"kind\": \"mesh\"", "\"kind\": \"cube\""), "cube");
  refused(with(good, "\"mesh_hash\": \"00ff\"", "\"mesh_hash\": 7"), "mesh_hash");
  refused(with(good, "\"seed\": 18446744073709551615", "\"seed\": -1"), "seed");
  refused(with(good, "\"amplitude_m\": 1e-17", "\"amplitude_m\": null"), "amplitude_m");
  refused(with(good, "\"pixel_samples\": 9", "\"pixel_samples\": 9, \"gravity\": 9.8"), "gravity");
  refused(with(good, "radius_m", "radius_cm"), "stage_toml");
}

TEST_CASE("subjects have a natural size unless one is given") {
  sim::SubjectSpec subject;
  CHECK(sim::subject_size_m(subject) == 0.25);
  subject.kind = sim::SubjectKind::kMirrorBall;
  CHECK(sim::subject_size_m(subject) == 0.06);
  subject.size_m = 0.1;
  CHECK(sim::subject_size_m(subject) == 0.1);
}
