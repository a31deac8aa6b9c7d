#include "capture/light_check.h"

#include <catch2/catch.hpp>
#include <cstdio>
#include <map>
#include <random>
#include <set>

#include "capture/stage.h"
#include "core/direction.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "sim/rig.h"

using namespace lightstage;
using capture::CameraPictures;
using capture::LightCheckReport;
using capture::LightFinding;
using capture::LightTrouble;
using core::kMillisecond;

namespace {

struct StageSpec {
  sim::SubjectKind subject = sim::SubjectKind::kProceduralHead;
  std::size_t lights = 60;
  int cameras = 1;
  std::uint64_t seed = 1;
  std::vector<int> dead;
};

// Noise and motion are on; lights hang a degree and a half from where they are drawn and differ in brightness.
sim::Simulation simulation_of(const StageSpec& spec) {
  capture::LayoutOptions layout;
  layout.layout = spec.seed % 2 == 0 ? capture::Layout::kFibonacci : capture::Layout::kGeodesic;
  layout.lights = spec.lights;
  layout.cameras = spec.cameras;
  layout.camera_pixels = spec.seed % 3 == 0 ? 64 : 48;
  sim::Simulation simulation;
  simulation.stage = capture::make_stage("test", layout);
  simulation.stage.simulation.seed = spec.seed;
  simulation.stage.simulation.mount_error_degrees = 1.5;
  simulation.stage.simulation.gain_spread = 0.1;
  simulation.stage.simulation.dead_lights = spec.dead;
  simulation.subject.kind = spec.subject;
  simulation.subject.seed = spec.seed;
  simulation.pixel_samples = 1;
  simulation.seed = spec.seed;
  return simulation;
}

// Outputs of a controller wired to other LEDs than their own.
class Miswired : public capture::LedController {
 public:
  Miswired(capture::LedController& leds, std::map<int, std::vector<int>> wires)
      : leds_(leds), wires_(std::move(wires)) {}
  std::size_t light_count() const override { return leds_.light_count(); }
  void show(std::span<const capture::LightLevel> levels) override {
    std::map<int, capture::LightLevel> lit;
    for (const capture::LightLevel& level : levels) {
      const auto wire = wires_.find(level.light_index);
      const std::vector<int> own{level.light_index};
      for (const int led : wire == wires_.end() ? own : wire->second) lit[led] = {led, level.r, level.g, level.b};
    }
    std::vector<capture::LightLevel> all;
    for (const auto& [led, level] : lit) all.push_back(level);
    leds_.show(all);
  }
  void all_off() override { leds_.all_off(); }

 private:
  capture::LedController& leds_;
  std::map<int, std::vector<int>> wires_;
};

struct Taken {
  std::vector<core::Vec3> positions;
  std::vector<CameraPictures> cameras;
  LightCheckReport check() const { return capture::check_lights(positions, cameras); }
};

Taken take(const StageSpec& spec, const std::map<int, std::vector<int>>& wires = {}) {
  core::set_quiet(true);
  const sim::World world(simulation_of(spec));
  core::VirtualClock clock;
  sim::SimulatedRig simulated(world, clock);
  const capture::Rig rig = simulated.rig();
  Miswired lights(rig.lights, wires);
  const capture::Rig miswired{lights, rig.trigger, rig.cameras, rig.clock};
  const capture::Sequence sequence = capture::make_light_check_sequence(spec.lights, 20 * kMillisecond);
  return {world.simulation().stage.light_positions, capture::take_light_pictures(sequence, miswired)};
}

std::string lines(const LightCheckReport& report) {
  std::string text = report.too_little;
  for (const LightFinding& finding : report.findings) text += "\n" + finding.text;
  return text;
}

bool names(const LightCheckReport& report, LightTrouble trouble, int light, const std::vector<int>& others = {}) {
  return std::any_of(report.findings.begin(), report.findings.end(), [&](const LightFinding& finding) {
    return finding.trouble == trouble && finding.light == light && finding.others == others;
  });
}

core::Image scaled_sum(const core::Image& a, float factor, const core::Image& b, float other_factor) {
  core::Image sum = a;
  for (std::size_t p = 0; p < sum.values().size(); ++p) {
    sum.values()[p] = factor * sum.values()[p] + other_factor * b.values()[p];
  }
  return sum;
}

// Pictures as they would be with this fault of light i (j, k: others), since light adds up.
Taken with_fault(const Taken& sound, const std::string& fault, std::size_t i, std::size_t j, std::size_t k) {
  Taken taken = sound;
  for (std::size_t c = 0; c < taken.cameras.size(); ++c) {
    std::vector<core::Image>& now = taken.cameras[c].of_light;
    const std::vector<core::Image>& was = sound.cameras[c].of_light;
    const core::Image& dark = sound.cameras[c].dark[i % sound.cameras[c].dark.size()];
    if (fault == "dead") now[i] = dark;
    if (fault == "weak, 30 %") now[i] = scaled_sum(was[i], 0.3f, dark, 0.9f);
    if (fault == "two swapped") std::swap(now[i], now[j]);
    if (fault == "three in a round") now[i] = was[j], now[j] = was[k], now[k] = was[i];
    if (fault == "lights another too") now[i] = scaled_sum(was[i], 1, was[j], 1);
    if (fault == "lights another instead") now[i] = was[j];
    if (fault == "both light both") now[i] = now[j] = scaled_sum(was[i], 1, was[j], 1);
  }
  return taken;
}

// Whether the fault is named as what it is, every light concerned included.
bool is_named(const LightCheckReport& report, const std::string& fault, int i, int j, int k) {
  if (fault == "dead") return names(report, LightTrouble::kDead, i);
  if (fault == "weak, 30 %") return names(report, LightTrouble::kWeak, i);
  if (fault == "two swapped") return names(report, LightTrouble::kSwapped, std::min(i, j), {std::max(i, j)});
  if (fault == "three in a round") {
    return names(report, LightTrouble::kSwapped, i, {j, k}) || names(report, LightTrouble::kSwapped, j, {k, i}) ||
           names(report, LightTrouble::kSwapped, k, {i, j});
  }
  return names(report, LightTrouble::kDouble, i, {j});
}

}  // namespace

TEST_CASE("a sound stage has no finding", "[light_check]") {
  for (const sim::SubjectKind subject : {sim::SubjectKind::kProceduralHead, sim::SubjectKind::kGreyBall}) {
    for (const std::size_t lights : {40, 70, 150}) {
      for (const std::uint64_t seed : {1, 2, 3}) {
        StageSpec spec;
        spec.subject = subject;
        spec.lights = lights;
        spec.cameras = seed == 2 ? 2 : 1;
        spec.seed = seed + 20;
        const LightCheckReport report = take(spec).check();
        CAPTURE(static_cast<int>(subject), lights, seed, lines(report));
        CHECK(report.findings.empty());
        CHECK(report.too_little.empty());
        CHECK(report.unjudged.size() <= lights / 20);
      }
    }
  }
}

TEST_CASE("dead, swapped and double lights of a miswired rig are named, all at once", "[light_check]") {
  const auto [subject, lights] = GENERATE(table<sim::SubjectKind, std::size_t>(
      {{sim::SubjectKind::kProceduralHead, 90}, {sim::SubjectKind::kGreyBall, 60}}));
  StageSpec spec;
  spec.subject = subject;
  spec.lights = lights;
  spec.seed = 3;
  const std::vector<core::Vec3> positions = simulation_of(spec).stage.light_positions;
  // Lights that the camera sees well, apart from each other: what is tested here is the way from wire to name.
  std::vector<int> chosen;
  for (int i = 0; i < static_cast<int>(lights); ++i) {
    const core::Direction d = core::Direction::from_vector(positions[static_cast<std::size_t>(i)]);
    const bool apart = std::all_of(chosen.begin(), chosen.end(), [&](int other) {
      return core::angle_radians(d, core::Direction::from_vector(positions[static_cast<std::size_t>(other)])) >
             core::radians_from_degrees(25);
    });
    if (d.z() > 0.1 && d.y() > -0.5 && apart) chosen.push_back(i);
  }
  REQUIRE(chosen.size() >= 10);
  const auto& c = chosen;
  spec.dead = {c[0]};
  const std::map<int, std::vector<int>> wires{
      {c[1], {c[2]}},       {c[2], {c[1]}},                  // swapped
      {c[3], {c[4]}},       {c[4], {c[5]}}, {c[5], {c[3]}},  // a round
      {c[6], {c[6], c[7]}},                                  // lights another one too
      {c[8], {c[9]}},                                        // instead
  };
  const LightCheckReport report = take(spec, wires).check();
  CAPTURE(lines(report));
  CHECK(names(report, LightTrouble::kDead, c[0]));
  CHECK(names(report, LightTrouble::kSwapped, c[1], {c[2]}));
  CHECK(names(report, LightTrouble::kSwapped, c[3], {c[4], c[5]}));
  CHECK(names(report, LightTrouble::kDouble, c[6], {c[7]}));
  CHECK(names(report, LightTrouble::kDouble, c[8], {c[9]}));
  CHECK(report.findings.size() == 5);
  const auto text_of = [&](int light) {
    return std::find_if(report.findings.begin(), report.findings.end(),
                        [&](const LightFinding& f) { return f.light == light; })
        ->text;
  };
  CHECK_THAT(text_of(c[0]),
             Catch::Matches("light " + std::to_string(c[0]) +
                            " is dead \\(or lit all the time\\): changes the picture by [0-9.e-]+ where its "
                            "neighbours predict 0\\.0[0-9]+"));
  CHECK_THAT(text_of(c[1]),
             Catch::Contains("light " + std::to_string(c[1]) + " and light " + std::to_string(c[2]) + " are swapped"));
}

TEST_CASE("how many faults of each kind are named", "[light_check]") {
  const std::vector<std::string> faults{
      "dead",           "weak, 30 %", "two swapped", "three in a round", "lights another too", "lights another instead",
      "both light both"};
  struct Count {
    int named = 0, noticed = 0, all = 0;
    double share() const { return static_cast<double>(named) / all; }
  };
  // By kind, and how far apart the lights are: within 1.3 spacings of the lights, 2.2, and beyond.
  std::map<std::pair<std::string, int>, Count> counts;
  int others_named = 0, checks = 0;
  std::mt19937_64 random(7);
  for (const sim::SubjectKind subject : {sim::SubjectKind::kProceduralHead, sim::SubjectKind::kGreyBall}) {
    for (const std::uint64_t seed : {1, 2, 3, 4}) {
      StageSpec spec;
      spec.subject = subject;
      spec.lights = seed % 2 == 0 ? 120 : 50;
      spec.cameras = seed > 2 ? 2 : 1;
      spec.seed = seed + 30;
      const Taken sound = take(spec);
      std::vector<core::Direction> directions;
      for (const core::Vec3& position : sound.positions) directions.push_back(core::Direction::from_vector(position));
      const double spacing = core::median_spacing_radians(directions);
      for (int trial = 0; trial < 60; ++trial) {
        const std::string& fault = faults[static_cast<std::size_t>(trial) % faults.size()];
        const std::size_t i = random() % spec.lights;
        // Every second pair lies close together.
        const std::vector<std::size_t> near = core::nearest_indices(directions, directions[i], spec.lights);
        const std::size_t j = near[1 + random() % (trial % 2 == 0 ? 12 : spec.lights - 1)];
        const std::size_t k = near[1 + random() % (spec.lights - 1)];
        if (k == j) continue;
        const LightCheckReport report = with_fault(sound, fault, i, j, k).check();
        const double apart = core::angle_radians(directions[i], directions[j]) / spacing;
        const bool of_one = fault == "dead" || fault == "weak, 30 %" || fault == "three in a round";
        Count& count = counts[{fault, of_one ? 2 : apart < 1.3 ? 0 : apart < 2.2 ? 1 : 2}];
        ++count.all;
        ++checks;
        count.noticed += report.findings.empty() ? 0 : 1;
        count.named += is_named(report, fault, static_cast<int>(i), static_cast<int>(j), static_cast<int>(k)) ? 1 : 0;
        const std::set<int> concerned{static_cast<int>(i), static_cast<int>(j), static_cast<int>(k)};
        for (const LightFinding& finding : report.findings) others_named += concerned.contains(finding.light) ? 0 : 1;
      }
    }
  }
  const char* const apart[]{"neighbours", "next but one", "farther"};
  for (const auto& [key, count] : counts) {
    std::printf(
        "light check: %-22s %-12s named %3d, noticed %3d of %3d\n", key.first.c_str(),
        key.first == "dead" || key.first.starts_with("weak") || key.first.starts_with("three") ? "" : apart[key.second],
        count.named, count.noticed, count.all);
  }
  std::printf("light check: lights named that have no fault: %d in %d checks\n", others_named, checks);
}

TEST_CASE("weak evidence is said to be none", "[light_check]") {
  StageSpec spec;
  spec.lights = 40;
  spec.seed = 5;
  const Taken sound = take(spec);
  Taken few = sound;
  few.positions.resize(12);
  for (CameraPictures& camera : few.cameras) camera.of_light.resize(12);
  CHECK_THAT(few.check().too_little, Catch::Contains("needs 16 lights, this stage has 12"));
  CHECK(few.check().unjudged.size() == 12);

  Taken no_dark = sound;
  no_dark.cameras[0].dark.resize(1);
  CHECK_THAT(no_dark.check().too_little, Catch::Contains("needs 2 of each camera, there are 1"));
  CHECK_THAT(capture::check_lights(sound.positions, {}).too_little, Catch::Contains("dark frames"));

  // Positions of another stage: nothing fits.
  Taken shuffled = sound;
  std::shuffle(shuffled.positions.begin(), shuffled.positions.end(), std::mt19937_64(1));
  CHECK_THAT(shuffled.check().too_little, Catch::Contains("more than a quarter"));

  Taken missing = sound;
  missing.cameras[0].of_light[3] = {};
  CHECK(missing.check().findings.empty());
  CHECK(missing.check().unjudged.front() <= 3);
  CHECK(std::count(missing.check().unjudged.begin(), missing.check().unjudged.end(), 3) == 1);

  // A room without any light: nothing is seen, nothing is missed.
  Taken black = sound;
  for (core::Image& picture : black.cameras[0].of_light) picture = black.cameras[0].dark[1];
  CHECK(black.check().findings.empty());
  CHECK(black.check().unjudged.size() == 40);

  Taken other_count = sound;
  other_count.positions.pop_back();
  CHECK_THROWS_AS(other_count.check(), core::BadInput);
  Taken other_size = sound;
  other_size.cameras[0].of_light[7] = core::Image(3, 3, 1);
  CHECK_THROWS_AS(other_size.check(), core::BadInput);
  Taken at_centre = sound;
  at_centre.positions[2] = {0, 0, 0};
  CHECK_THROWS_AS(at_centre.check(), core::BadInput);
}

TEST_CASE("the check's sequence shoots every light once, dark frames among them", "[light_check]") {
  const capture::Sequence sequence = capture::make_light_check_sequence(45, 8 * kMillisecond);
  std::vector<int> lights;
  std::string kinds;
  for (std::size_t i = 0; i < sequence.steps.size(); ++i) {
    const db::Step& step = sequence.steps[i];
    CHECK(step.step_index == static_cast<int>(i));
    CHECK(step.exposure_ns == 8 * kMillisecond);
    if (step.kind == db::StepKind::kLight) lights.push_back(*step.light_index);
    kinds += step.kind == db::StepKind::kLight ? '.' : step.kind == db::StepKind::kDark ? 'd' : '?';
  }
  CHECK(kinds == "ddd" + std::string(20, '.') + "d" + std::string(20, '.') + "d" + std::string(5, '.') + "d");
  for (int i = 0; i < 45; ++i) CHECK(lights.at(static_cast<std::size_t>(i)) == i);

  core::set_quiet(true);
  StageSpec spec;
  spec.lights = 20;
  const sim::World world(simulation_of(spec));
  core::VirtualClock clock;
  sim::SimulatedRig rig(world, clock);
  std::size_t frames = 0;
  capture::SessionOptions options;
  options.on_frame = [&](const db::Step&, const std::string&, const capture::CameraFrame&) { ++frames; };
  const auto pictures =
      capture::take_light_pictures(capture::make_light_check_sequence(20, 20 * kMillisecond), rig.rig(), options);
  REQUIRE(pictures.size() == 1);
  CHECK(frames == 24);
  CHECK(pictures[0].of_light.size() == 20);
  CHECK(pictures[0].dark.size() == 4);
  CHECK(pictures[0].of_light[0].size() == core::ImageSize{24, 24, 1});

  capture::Sequence no_dark = sequence;
  std::erase_if(no_dark.steps, [](const db::Step& step) { return step.kind == db::StepKind::kDark; });
  CHECK_THROWS_AS(capture::take_light_pictures(no_dark, rig.rig()), core::UsageError);
}
