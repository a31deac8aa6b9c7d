// Sequence files: TOML out and in.
#include <algorithm>
#include <limits>
#include <set>

#include "capture/sequence.h"
#include "capture/toml/number.h"
#include "core/config.h"

namespace lightstage::capture {

namespace {

constexpr double kLongestExposureMs = 3600e3;
constexpr double kLongestSettleMs = 60e3;
constexpr double kLongestHoldMs = 500;
constexpr std::size_t kMaxSteps = 1'000'000;

double milliseconds(core::Nanoseconds time) {
  return core::in_units(time, core::kMillisecond);
}
core::Nanoseconds nanoseconds(double time_ms) {
  return core::from_units(time_ms, core::kMillisecond);
}

// The last step of the run of single lights with rising index and one exposure that starts at `first`.
std::size_t end_of_run(const std::vector<db::Step>& steps, std::size_t first) {
  std::size_t last = first;
  while (last + 1 < steps.size()) {
    db::Step expected = steps[last];
    expected.light_index = *expected.light_index + 1;
    if (!same_shot(expected, steps[last + 1])) break;
    ++last;
  }
  return last;
}

void append_pattern(std::string& text, const db::Step& step) {
  for (const LightLevel& l : levels(step, std::numeric_limits<int>::max())) {
    text += "[[step.level]]\nlight = " + std::to_string(l.light_index) + "\n";
    text += "rgb = [" + toml_number(l.r) + ", " + toml_number(l.g) + ", " + toml_number(l.b) + "]\n";
  }
}

int read_light(const core::TomlTable& table, std::string_view key, double light, std::size_t light_count) {
  if (light != std::floor(light) || light < 0 || light >= static_cast<double>(light_count)) {
    table.fail(key, "must be a light of the stage, which has " + std::to_string(light_count) + " (counted from 0)");
  }
  return static_cast<int>(light);
}

std::string read_pattern(const core::TomlTable& table, std::size_t light_count) {
  std::vector<LightLevel> pattern;
  std::set<int> lit;
  for (const core::TomlTable& entry : table.tables("level")) {
    const int light = read_light(entry, "light", static_cast<double>(entry.integer("light")), light_count);
    if (!lit.insert(light).second) entry.fail("light", "is in this pattern already");
    const std::vector<double> rgb = entry.numbers("rgb", 3);
    if (std::any_of(rgb.begin(), rgb.end(), [](double v) { return v < 0 || v > 1; })) {
      entry.fail("rgb", "must hold levels from 0 to 1");
    }
    pattern.push_back({light, static_cast<float>(rgb[0]), static_cast<float>(rgb[1]), static_cast<float>(rgb[2])});
  }
  return pattern_of(pattern);
}

struct LightRange {
  int first = 0, last = 0;
};

LightRange read_lights(const core::TomlTable& table, std::size_t light_count) {
  if (!table.has("lights")) {
    const int light = read_light(table, "light", static_cast<double>(table.integer("light")), light_count);
    return {light, light};
  }
  const std::vector<double> range = table.numbers("lights", 2);
  const LightRange lights{read_light(table, "lights", range[0], light_count),
                          read_light(table, "lights", range[1], light_count)};
  if (lights.first > lights.last) table.fail("lights", "must be [first, last] with first <= last");
  return lights;
}

db::StepKind read_kind(const core::TomlTable& table) {
  using enum db::StepKind;
  const std::string name = table.string("kind");
  for (const db::StepKind kind : {kDark, kFullOn, kTracking, kLight, kPattern}) {
    if (name == db::to_string(kind)) return kind;
  }
  table.fail("kind", "must be dark, full_on, tracking, light or pattern");
}

core::Nanoseconds read_exposure(const core::TomlTable& table) {
  const double exposure_ms = table.number("exposure_ms");
  if (!(exposure_ms <= kLongestExposureMs) || nanoseconds(exposure_ms) <= 0) {
    table.fail("exposure_ms", "must be above 0 and at most 3600000 (one hour)");
  }
  return nanoseconds(exposure_ms);
}

Timing read_timing(const core::TomlTable& table) {
  if (!table.has("timing")) return {};
  const std::string name = table.string("timing");
  for (const Timing timing : kTimings) {
    if (name == to_string(timing)) return timing;
  }
  table.fail("timing", "must be lockstep, pipelined or free_run");
}

void read_steps(const core::TomlTable& table, std::size_t light_count, std::vector<db::Step>& steps) {
  db::Step step;
  step.kind = read_kind(table);
  step.exposure_ns = read_exposure(table);
  if (step.kind == db::StepKind::kPattern) step.pattern = read_pattern(table, light_count);
  const LightRange lights = step.kind == db::StepKind::kLight ? read_lights(table, light_count) : LightRange{};
  for (int light = lights.first; light <= lights.last; ++light) {
    if (step.kind == db::StepKind::kLight) step.light_index = light;
    step.step_index = static_cast<int>(steps.size());
    steps.push_back(step);
    if (steps.size() > kMaxSteps) table.fail("kind", "starts more steps than a sequence may have (a million)");
  }
}

Sequence read_table(const core::TomlTable& table, std::size_t light_count) {
  Sequence sequence;
  const double settle_ms = table.number("settle_ms", milliseconds(sequence.settle));
  if (settle_ms < 0 || settle_ms > kLongestSettleMs) table.fail("settle_ms", "must be 0 to 60000 (one minute)");
  sequence.settle = nanoseconds(settle_ms);
  sequence.timing = read_timing(table);
  const double hold_ms = table.number("hold_ms", milliseconds(sequence.hold));
  if (hold_ms < 0 || hold_ms > kLongestHoldMs) table.fail("hold_ms", "must be 0 to 500");
  sequence.hold = nanoseconds(hold_ms);
  for (const core::TomlTable& entry : table.tables("step")) read_steps(entry, light_count, sequence.steps);
  table.finish();
  if (sequence.steps.empty()) table.fail("step", "is missing: a sequence needs at least one [[step]]");
  return sequence;
}

}  // namespace

std::string to_toml(const Sequence& sequence) {
  std::string text =
      "# What is lit and shot, in this order. Kinds: dark, full_on, tracking (all lights, to follow "
      "motion),\n"
      "# light (light = INDEX, or lights = [FIRST, LAST] one after another), pattern (a [[step.level]] for "
      "each light).\n";
  text += "settle_ms = " + toml_number(milliseconds(sequence.settle)) + "\n";
  text += "hold_ms = " + toml_number(milliseconds(sequence.hold)) + "\n";
  text += "timing = \"" + std::string(to_string(sequence.timing)) + "\"\n";
  for (std::size_t i = 0; i < sequence.steps.size(); ++i) {
    const db::Step& step = sequence.steps[i];
    text += "\n[[step]]\nkind = \"" + std::string(db::to_string(step.kind)) + "\"\n";
    text += "exposure_ms = " + toml_number(milliseconds(step.exposure_ns)) + "\n";
    if (step.kind == db::StepKind::kPattern) append_pattern(text, step);
    if (step.kind != db::StepKind::kLight) continue;
    const int first = levels(step, std::numeric_limits<int>::max()).front().light_index;
    const std::size_t last = end_of_run(sequence.steps, i);
    if (last == i) {
      text += "light = " + std::to_string(first) + "\n";
    } else {
      text += "lights = [" + std::to_string(first) + ", " + std::to_string(first + static_cast<int>(last - i)) + "]\n";
    }
    i = last;
  }
  return text;
}

Sequence parse_sequence(std::string_view toml, const std::string& source_name, std::size_t light_count) {
  return read_table(core::TomlTable::parse(toml, source_name), light_count);
}

Sequence read_sequence(const std::filesystem::path& path, std::size_t light_count) {
  return read_table(core::TomlTable::read_file(path), light_count);
}

}  // namespace lightstage::capture
