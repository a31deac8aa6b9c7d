#include "capture/sequence.h"

#include <nlohmann/json.hpp>
#include <set>

#include "core/error.h"

namespace lightstage::capture {

namespace {

constexpr core::Nanoseconds kLongestExposure = 3600 * core::kSecond;

bool good_exposure(core::Nanoseconds exposure) {
  return exposure > 0 && exposure <= kLongestExposure;
}

void append(Sequence& sequence, db::StepKind kind, core::Nanoseconds exposure, std::optional<int> light = {}) {
  db::Step step;
  step.step_index = static_cast<int>(sequence.steps.size());
  step.kind = kind;
  step.light_index = light;
  step.exposure_ns = exposure;
  sequence.steps.push_back(std::move(step));
}

[[noreturn]] void fail(const db::Step& step, const std::string& problem) {
  throw core::BadInput("step " + std::to_string(step.step_index) + " of the sequence: " + problem);
}

void check_light(const db::Step& step, std::int64_t light, std::size_t light_count) {
  if (light < 0 || light >= static_cast<std::int64_t>(light_count)) {
    fail(step, "light " + std::to_string(light) + " is not one of the stage's " + std::to_string(light_count) +
                   " (counted from 0)");
  }
}

float level(const db::Step& step, const nlohmann::json& value) {
  if (!value.is_number()) fail(step, "a level of its pattern is not a number");
  const double level = value.get<double>();
  if (!(level >= 0 && level <= 1)) fail(step, "a level of its pattern is not within 0 and 1");
  return static_cast<float>(level);
}

std::vector<LightLevel> pattern_levels(const db::Step& step, std::size_t light_count) {
  const nlohmann::json pattern = nlohmann::json::parse(step.pattern, nullptr, false);
  if (!pattern.is_array()) fail(step, "its pattern is not a list [[light, r, g, b], ...]");
  std::vector<LightLevel> result;
  std::set<std::int64_t> seen;
  for (const nlohmann::json& entry : pattern) {
    if (!entry.is_array() || entry.size() != 4 || !entry[0].is_number_integer()) {
      fail(step, "its pattern is not a list [[light, r, g, b], ...]");
    }
    const auto light = entry[0].get<std::int64_t>();
    check_light(step, light, light_count);
    if (!seen.insert(light).second) fail(step, "its pattern lists light " + std::to_string(light) + " twice");
    result.push_back({static_cast<int>(light), level(step, entry[1]), level(step, entry[2]), level(step, entry[3])});
  }
  return result;
}

}  // namespace

std::string_view to_string(Timing timing) {
  switch (timing) {
    case Timing::kLockstep:
      return "lockstep";
    case Timing::kPipelined:
      return "pipelined";
    case Timing::kFreeRun:
      return "free_run";
  }
  return "";
}

core::Nanoseconds default_full_on_exposure(core::Nanoseconds exposure, std::size_t light_count) {
  if (light_count <= 3) return exposure;
  return std::max<core::Nanoseconds>(1, exposure * 3 / static_cast<core::Nanoseconds>(light_count));
}

Sequence make_olat_sequence(const OlatOptions& options) {
  if (options.light_count == 0) throw core::UsageError("a sequence needs at least one light");
  if (options.tracking_every < 0) throw core::UsageError("tracking frames: every n-th light, n must not be negative");
  if (options.dark_frames < 0) throw core::UsageError("the number of dark frames must not be negative");
  if (!good_exposure(options.exposure) || !good_exposure(options.full_on_exposure.value_or(1))) {
    throw core::UsageError("exposures must be above 0 and at most one hour");
  }
  std::vector<core::Nanoseconds> exposures{options.exposure};
  for (const core::Nanoseconds exposure : options.further_exposures) {
    if (!good_exposure(exposure)) throw core::UsageError("exposures must be above 0 and at most one hour");
    if (std::find(exposures.begin(), exposures.end(), exposure) != exposures.end()) {
      throw core::UsageError("an exposure of the lights is given twice");
    }
    exposures.push_back(exposure);
  }
  const core::Nanoseconds full_on_exposure =
      options.full_on_exposure.value_or(default_full_on_exposure(options.exposure, options.light_count));

  Sequence sequence;
  // In units of radiance a frame's noise falls with its exposure, and the dark level is taken off every other frame.
  std::vector<core::Nanoseconds> dark_exposures = exposures;
  const auto longest = std::max_element(dark_exposures.begin(), dark_exposures.end());
  *longest = std::max(*longest, full_on_exposure);
  for (const core::Nanoseconds exposure : dark_exposures) {
    for (int i = 0; i < options.dark_frames; ++i) append(sequence, db::StepKind::kDark, exposure);
  }
  if (options.full_on) append(sequence, db::StepKind::kFullOn, full_on_exposure);
  const int light_count = static_cast<int>(options.light_count);
  for (int light = 0; light < light_count; ++light) {
    if (options.tracking_every > 0 && light % options.tracking_every == 0) {
      append(sequence, db::StepKind::kTracking, full_on_exposure);
    }
    for (const core::Nanoseconds exposure : exposures) append(sequence, db::StepKind::kLight, exposure, light);
  }
  if (options.tracking_every > 0) append(sequence, db::StepKind::kTracking, full_on_exposure);
  return sequence;
}

std::vector<LightLevel> levels(const db::Step& step, std::size_t light_count) {
  switch (step.kind) {
    case db::StepKind::kDark:
      return {};
    case db::StepKind::kLight:
      if (!step.light_index) fail(step, "it lights one light but does not say which");
      check_light(step, *step.light_index, light_count);
      return {{*step.light_index}};
    case db::StepKind::kTracking:
    case db::StepKind::kFullOn: {
      std::vector<LightLevel> all(light_count);
      for (std::size_t i = 0; i < light_count; ++i) all[i].light_index = static_cast<int>(i);
      return all;
    }
    case db::StepKind::kPattern:
      return pattern_levels(step, light_count);
  }
  fail(step, "it is of an unknown kind");
}

std::string pattern_of(std::span<const LightLevel> levels) {
  nlohmann::json pattern = nlohmann::json::array();
  for (const LightLevel& l : levels) {
    // Every float is a double, so nothing is lost in the decimal text.
    pattern.push_back({l.light_index, static_cast<double>(l.r), static_cast<double>(l.g), static_cast<double>(l.b)});
  }
  return pattern.dump();
}

bool same_shot(const db::Step& a, const db::Step& b) {
  return a.kind == b.kind && a.light_index == b.light_index && a.exposure_ns == b.exposure_ns && a.pattern == b.pattern;
}

int key_step(const std::vector<db::Step>& steps) {
  const int last = static_cast<int>(steps.size()) - 1;
  int key = -1;
  // Distances from the middle are doubled to stay integers.
  const auto off_middle = [last](int i) { return std::abs(2 * i - last); };
  for (int i = 0; i <= last; ++i) {
    const bool tracking = steps[static_cast<std::size_t>(i)].kind == db::StepKind::kTracking;
    if (tracking && (key < 0 || off_middle(i) < off_middle(key))) key = i;
  }
  if (key < 0) {
    const auto full_on =
        std::find_if(steps.begin(), steps.end(), [](const db::Step& s) { return s.kind == db::StepKind::kFullOn; });
    if (full_on != steps.end()) key = static_cast<int>(full_on - steps.begin());
  }
  return key < 0 ? -1 : steps[static_cast<std::size_t>(key)].step_index;
}

}  // namespace lightstage::capture
