#include "capture/sequence.h"

#include <catch2/catch.hpp>
#include <fstream>
#include <random>

#include "core/error.h"
#include "support/support.h"

using namespace lightstage;
using capture::LightLevel;
using capture::OlatOptions;
using capture::Sequence;
using db::StepKind;

namespace {

std::vector<StepKind> kinds(const Sequence& sequence) {
  std::vector<StepKind> result;
  for (const db::Step& step : sequence.steps) result.push_back(step.kind);
  return result;
}

bool same(const Sequence& a, const Sequence& b) {
  const auto same_step = [](const db::Step& x, const db::Step& y) {
    return x.step_index == y.step_index && capture::same_shot(x, y);
  };
  return a.settle == b.settle && a.hold == b.hold && a.timing == b.timing &&
         std::equal(a.steps.begin(), a.steps.end(), b.steps.begin(), b.steps.end(), same_step);
}

std::string message_of(const std::string& toml, std::size_t light_count = 10) {
  try {
    capture::parse_sequence(toml, "sequence.toml", light_count);
  } catch (const core::BadInput& error) {
    return error.what();
  }
  return "(no error)";
}

db::Step step_of(StepKind kind, std::optional<int> light = {}, std::string pattern = "") {
  db::Step step;
  step.kind = kind;
  step.light_index = light;
  step.exposure_ns = 1000;
  step.pattern = std::move(pattern);
  return step;
}

}  // namespace

TEST_CASE("an OLAT sequence has dark, full-on, every light once, tracking frames between and at both ends") {
  OlatOptions options;
  options.light_count = 7;
  options.tracking_every = 3;
  options.dark_frames = 2;
  const Sequence sequence = capture::make_olat_sequence(options);
  using enum StepKind;
  CHECK(kinds(sequence) == std::vector<StepKind>{kDark, kDark, kFullOn, kTracking, kLight, kLight, kLight, kTracking,
                                                 kLight, kLight, kLight, kTracking, kLight, kTracking});
  int next_light = 0;
  for (std::size_t i = 0; i < sequence.steps.size(); ++i) {
    const db::Step& step = sequence.steps[i];
    CHECK(step.step_index == static_cast<int>(i));
    CHECK(step.light_index.has_value() == (step.kind == kLight));
    if (step.kind == kLight) CHECK(*step.light_index == next_light++);
    const bool all_lit = step.kind == kTracking || step.kind == kFullOn;
    CHECK(step.exposure_ns == (all_lit ? 20 * core::kMillisecond * 3 / 7 : 20 * core::kMillisecond));
  }
  CHECK(next_light == 7);
}

TEST_CASE("a bracket takes every light with each exposure, and dark frames of each") {
  OlatOptions options;
  options.light_count = 4;
  options.tracking_every = 2;
  options.dark_frames = 2;
  options.exposure = 20 * core::kMillisecond;
  options.further_exposures = {5 * core::kMillisecond, 80 * core::kMillisecond};
  const Sequence sequence = capture::make_olat_sequence(options);
  std::vector<core::Nanoseconds> dark, light;
  for (const db::Step& step : sequence.steps) {
    if (step.kind == StepKind::kDark) dark.push_back(step.exposure_ns / core::kMillisecond);
    if (step.kind == StepKind::kLight && *step.light_index == 1) light.push_back(step.exposure_ns / core::kMillisecond);
    if (step.kind == StepKind::kTracking) CHECK(step.exposure_ns == 15 * core::kMillisecond);
  }
  CHECK(dark == std::vector<core::Nanoseconds>{20, 20, 5, 5, 80, 80});
  CHECK(light == std::vector<core::Nanoseconds>{20, 5, 80});
  CHECK(sequence.steps.size() == 6 + 1 + 3 + 12);
  CHECK(capture::parse_sequence(capture::to_toml(sequence), "sequence.toml", 4).steps.size() == sequence.steps.size());
  options.further_exposures = {20 * core::kMillisecond};
  CHECK_THROWS_AS(capture::make_olat_sequence(options), core::UsageError);
  options.further_exposures = {0};
  CHECK_THROWS_AS(capture::make_olat_sequence(options), core::UsageError);
}

TEST_CASE("tracking, dark and full-on frames can be left out") {
  OlatOptions options;
  options.light_count = 2;
  options.tracking_every = 0;
  options.dark_frames = 0;
  options.full_on = false;
  CHECK(kinds(capture::make_olat_sequence(options)) == std::vector<StepKind>{StepKind::kLight, StepKind::kLight});
}

TEST_CASE("the full-on exposure goes down with the number of lights and never clips") {
  const core::Nanoseconds exposure = 20 * core::kMillisecond;
  for (const std::size_t n : {1u, 2u, 3u, 4u, 180u, 10000u}) {
    const core::Nanoseconds full_on = capture::default_full_on_exposure(exposure, n);
    CHECK(full_on > 0);
    CHECK(full_on <= exposure);
    // n / 4 times the light of one; one light head-on may take 0.9 of the scale.
    if (n >= 4) CHECK(static_cast<double>(full_on) * static_cast<double>(n) / 4 <= static_cast<double>(exposure));
  }
  CHECK(capture::default_full_on_exposure(exposure, 180) == 333'333);
  OlatOptions options;
  options.light_count = 180;
  options.full_on_exposure = 123;
  CHECK(capture::make_olat_sequence(options).steps[3].exposure_ns == 123);
}

TEST_CASE("sequences that cannot be are refused") {
  const auto refused = [](auto change) {
    OlatOptions options;
    options.light_count = 4;
    change(options);
    CHECK_THROWS_AS(capture::make_olat_sequence(options), core::UsageError);
  };
  refused([](OlatOptions& o) { o.light_count = 0; });
  refused([](OlatOptions& o) { o.tracking_every = -1; });
  refused([](OlatOptions& o) { o.dark_frames = -1; });
  refused([](OlatOptions& o) { o.exposure = 0; });
  refused([](OlatOptions& o) { o.exposure = 3601 * core::kSecond; });
  refused([](OlatOptions& o) { o.full_on_exposure = -5; });
}

TEST_CASE("levels say exactly what a step lights") {
  CHECK(capture::levels(step_of(StepKind::kDark), 3).empty());
  CHECK(capture::levels(step_of(StepKind::kLight, 2), 3) == std::vector<LightLevel>{{2, 1, 1, 1}});
  const std::vector<LightLevel> all{{0, 1, 1, 1}, {1, 1, 1, 1}, {2, 1, 1, 1}};
  CHECK(capture::levels(step_of(StepKind::kFullOn), 3) == all);
  CHECK(capture::levels(step_of(StepKind::kTracking), 3) == all);

  const std::vector<LightLevel> pattern{{2, 0.1f, 0, 1}, {0, 1.0f / 3, std::nextafter(0.5f, 1.0f), 1e-30f}};
  CHECK(capture::levels(step_of(StepKind::kPattern, {}, capture::pattern_of(pattern)), 3) == pattern);
  CHECK(capture::levels(step_of(StepKind::kPattern, {}, "[]"), 3).empty());
}

TEST_CASE("steps that light what is not there are refused") {
  const auto refused = [](const db::Step& step, const std::string& problem) {
    CHECK_THROWS_WITH(capture::levels(step, 3), "step 0 of the sequence: " + problem);
  };
  refused(step_of(StepKind::kLight, 3), "light 3 is not one of the stage's 3 (counted from 0)");
  refused(step_of(StepKind::kLight, -1), "light -1 is not one of the stage's 3 (counted from 0)");
  refused(step_of(StepKind::kLight), "it lights one light but does not say which");
  refused(step_of(StepKind::kPattern, {}, "[[3,1,1,1]]"), "light 3 is not one of the stage's 3 (counted from 0)");
  refused(step_of(StepKind::kPattern, {}, "[[1,1,1,1],[1,0,0,0]]"), "its pattern lists light 1 twice");
  refused(step_of(StepKind::kPattern, {}, "[[1,1,1,1.5]]"), "a level of its pattern is not within 0 and 1");
  refused(step_of(StepKind::kPattern, {}, "[[1,1,1,null]]"), "a level of its pattern is not a number");
  for (const char* text : {"", "{", "{}", "7", "[1]", "[[1,1,1]]", "[[0.5,1,1,1]]"}) {
    refused(step_of(StepKind::kPattern, {}, text), "its pattern is not a list [[light, r, g, b], ...]");
  }
}

TEST_CASE("the key step is the tracking step nearest the middle") {
  using enum StepKind;
  const auto key = [](std::initializer_list<StepKind> list) {
    std::vector<db::Step> steps;
    for (const StepKind kind : list) {
      steps.push_back(step_of(kind));
      steps.back().step_index = static_cast<int>(steps.size()) - 1;
    }
    return capture::key_step(steps);
  };
  CHECK(key({kTracking, kLight, kTracking, kLight, kLight, kTracking}) == 2);
  CHECK(key({kTracking, kLight, kLight, kTracking}) == 0);  // a tie: the earlier
  CHECK(key({kFullOn, kTracking}) == 1);
  CHECK(key({kDark, kFullOn, kLight, kFullOn}) == 1);
  CHECK(key({kDark, kLight}) == -1);
  CHECK(key({}) == -1);
}

TEST_CASE("a sequence file reads back exactly") {
  OlatOptions options;
  options.light_count = 180;
  options.exposure = 16'666'667;
  Sequence sequence = capture::make_olat_sequence(options);
  sequence.settle = 1'234'567;
  sequence.hold = 123'456;
  sequence.timing = capture::Timing::kPipelined;
  db::Step pattern = step_of(
      StepKind::kPattern, {},
      capture::pattern_of(std::vector<LightLevel>{{179, 0.1f, 1.0f / 3, 0}, {0, 1, std::nextafter(1.0f, 0.0f), 0.5f}}));
  db::Step dark_pattern = step_of(StepKind::kPattern, {}, "[]");
  db::Step backwards = step_of(StepKind::kLight, 5), longest = step_of(StepKind::kLight, 6);
  longest.exposure_ns = 3600 * core::kSecond;
  for (db::Step step : {pattern, dark_pattern, backwards, longest, backwards}) {
    step.step_index = static_cast<int>(sequence.steps.size());
    sequence.steps.push_back(step);
  }

  const std::string text = capture::to_toml(sequence);
  CHECK(same(capture::parse_sequence(text, "sequence.toml", 180), sequence));
  // Ten lights between two tracking frames are one entry: 3 dark, full-on, 18 x (tracking + run), tracking,
  // and the five above.
  std::size_t entries = 0;
  for (std::size_t at = text.find("[[step]]"); at != std::string::npos; at = text.find("[[step]]", at + 1)) ++entries;
  CHECK(entries == 3 + 1 + 18 * 2 + 1 + 5);

  const test::TemporaryFolder folder;
  std::ofstream(folder / "sequence.toml") << text;
  CHECK(same(capture::read_sequence(folder / "sequence.toml", 180), sequence));
}

TEST_CASE("random sequences read back exactly") {
  std::mt19937_64 random(5);
  const auto below = [&](std::uint64_t n) { return random() % n; };
  for (int round = 0; round < 50; ++round) {
    Sequence sequence;
    sequence.settle = static_cast<core::Nanoseconds>(below(60'000'000'000));
    sequence.hold = static_cast<core::Nanoseconds>(below(500'000'000));
    sequence.timing = static_cast<capture::Timing>(below(3));
    const std::size_t count = 1 + below(40);
    for (std::size_t i = 0; i < count; ++i) {
      const auto kind = static_cast<StepKind>(below(5));
      db::Step step = step_of(kind);
      // Small ranges, so that runs of lights and equal exposures are common.
      if (kind == StepKind::kLight) step.light_index = static_cast<int>(below(4));
      if (kind == StepKind::kPattern) {
        std::vector<LightLevel> levels;
        for (int light = 0; light < 3; ++light) {
          const auto level = [&] { return static_cast<float>(below(1u << 24)) / static_cast<float>((1u << 24) - 1); };
          if (below(2) == 0) levels.push_back({light, level(), level(), level()});
        }
        step.pattern = capture::pattern_of(levels);
      }
      step.exposure_ns = below(2) == 0 ? 20'000'000 : static_cast<core::Nanoseconds>(1 + below(3'600'000'000'000));
      step.step_index = static_cast<int>(i);
      sequence.steps.push_back(step);
    }
    const std::string text = capture::to_toml(sequence);
    CAPTURE(text);
    REQUIRE(same(capture::parse_sequence(text, "sequence.toml", 4), sequence));
  }
}

TEST_CASE("hand-written sequence files may leave the settling time out") {
  const Sequence sequence =
      capture::parse_sequence("[[step]]\nkind = \"light\"\nlights = [2, 4]\nexposure_ms = 5\n", "sequence.toml", 10);
  CHECK(sequence.settle == Sequence().settle);
  REQUIRE(sequence.steps.size() == 3);
  CHECK(sequence.steps[2].light_index == 4);
  CHECK(sequence.steps[2].step_index == 2);
  CHECK(sequence.steps[2].exposure_ns == 5 * core::kMillisecond);
}

TEST_CASE("malformed sequence files are refused with file, line and key") {
  const std::string start = "settle_ms = 2\n\n[[step]]\nexposure_ms = 20\n";
  const std::string no_such_light = " must be a light of the stage, which has 10 (counted from 0)";
  const auto with = [&](const std::string& rest) { return message_of(start + rest); };
  CHECK(with("kind = \"dark\"\n") == "(no error)");
  CHECK(with("kind = \"lite\"\n") ==
        "sequence.toml:5: key 'step[0].kind' must be dark, full_on, tracking, light or pattern");
  CHECK(with("kind = \"light\"\n") == "sequence.toml:3: key 'step[0].light' is missing");
  CHECK(with("kind = \"light\"\nlight = 10\n") == "sequence.toml:6: key 'step[0].light'" + no_such_light);
  CHECK(with("kind = \"light\"\nlight = -1\n") == "sequence.toml:6: key 'step[0].light'" + no_such_light);
  CHECK(with("kind = \"light\"\nlights = [0, 10]\n") == "sequence.toml:6: key 'step[0].lights'" + no_such_light);
  CHECK(with("kind = \"light\"\nlights = [0.5, 3]\n") == "sequence.toml:6: key 'step[0].lights'" + no_such_light);
  CHECK(with("kind = \"light\"\nlights = [4, 3]\n") ==
        "sequence.toml:6: key 'step[0].lights' must be [first, last] with first <= last");
  CHECK(with("kind = \"light\"\nlights = [4, 5, 6]\n") ==
        "sequence.toml:6: key 'step[0].lights' must have 2 numbers, not 3");
  CHECK(with("kind = \"light\"\nlight = 1\nlights = [1, 2]\n") ==
        "sequence.toml:6: key 'step[0].light' is not known (did you mean 'lights'?)");
  CHECK(with("kind = \"dark\"\nlight = 1\n") == "sequence.toml:6: key 'step[0].light' is not known");
  CHECK(with("kind = \"pattern\"\n[[step.level]]\nlight = 1\nrgb = [1, 1, 1.5]\n") ==
        "sequence.toml:8: key 'step[0].level[0].rgb' must hold levels from 0 to 1");
  CHECK(with("kind = \"pattern\"\n[[step.level]]\nlight = 10\nrgb = [1, 1, 1]\n") ==
        "sequence.toml:7: key 'step[0].level[0].light'" + no_such_light);
  CHECK(with("kind = \"pattern\"\n[[step.level]]\nlight = 1\nrgb = [1,1,1]\n[[step.level]]\nlight = 1\nrgb = "
             "[0,0,0]\n") == "sequence.toml:10: key 'step[0].level[1].light' is in this pattern already");
  const std::string exposure = "[[step]]\nkind = \"dark\"\nexposure_ms = ";
  const std::string bad_exposure =
      "sequence.toml:3: key 'step[0].exposure_ms' must be above 0 and at most 3600000 (one hour)";
  for (const char* value : {"0", "-1", "1e-7", "3600000.1", "1e300"}) {
    CHECK(message_of(exposure + value + "\n") == bad_exposure);
  }
  CHECK(message_of(exposure + "inf\n") == "sequence.toml:3: key 'step[0].exposure_ms' must be finite");
  CHECK(message_of("settle_ms = -1\n" + exposure + "1\n") ==
        "sequence.toml:1: key 'settle_ms' must be 0 to 60000 (one minute)");
  CHECK(message_of("settle_ms = 1\n").find("key 'step' is missing: a sequence needs at least one [[step]]") !=
        std::string::npos);
  CHECK(message_of(exposure + "1\nlights\n").starts_with("sequence.toml:4: "));
  // A huge range is refused before it fills the memory.
  CHECK(
      message_of("[[step]]\nkind = \"light\"\nlights = [0, 4000000]\nexposure_ms = 1\n", 5'000'000).find("a million") !=
      std::string::npos);
}
