// What is lit and shot, step by step.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/clock.h"
#include "db/store.h"

namespace lightstage::capture {

// One light's brightness, 0 to 1 of what it can give.
struct LightLevel {
  int light_index = 0;
  float r = 1, g = 1, b = 1;
  friend bool operator==(const LightLevel&, const LightLevel&) = default;
};

// How lights, exposures and frames follow each other. All store the same pictures; the faster ones ask more of the
// devices.
enum class Timing {
  // Light, settle, trigger, wait for every frame. Needs nothing but a trigger.
  kLockstep,
  // The controller holds the sequence and steps on at the end of each exposure (capture/devices.h, PatternPlayer); the next
  // exposure is triggered while frames still travel.
  kPipelined,
  // Cameras run free; every light stays on for one whole exposure at least, and frames are matched to lights by their
  // time stamps. Needs no trigger.
  kFreeRun,
};
inline constexpr std::array kTimings{Timing::kLockstep, Timing::kPipelined, Timing::kFreeRun};
std::string_view to_string(Timing timing);  // "lockstep", "pipelined", "free_run"

struct Sequence {
  std::vector<db::Step> steps;                        // step_index is the place in this list
  core::Nanoseconds settle = 2 * core::kMillisecond;  // from switching lights to the start of the exposure
  Timing timing = Timing::kLockstep;
  // Pipelined: lights outlast the first camera's exposure by so much, for the others, which begin a little later.
  core::Nanoseconds hold = core::kMillisecond / 2;
};

struct OlatOptions {
  std::size_t light_count = 0;
  int tracking_every = 10;  // a tracking frame before every n-th light and one at the end; 0 for none
  int dark_frames = 3;  // at the start, as long as the longest of the others; of a bracket as many for each exposure
  bool full_on = true;  // one full-on frame after the dark ones
  core::Nanoseconds exposure = 20 * core::kMillisecond;  // of the single lights
  // A bracket: every light is taken again with each of these, right after `exposure`, and loading merges them (db/scan_loader.h).
  std::vector<core::Nanoseconds> further_exposures;
  // Of full-on and tracking frames; if not given, default_full_on_exposure.
  std::optional<core::Nanoseconds> full_on_exposure;
};

// exposure * 3 / light_count (never more than `exposure`): n unit lights all round give a white Lambertian
// surface radiance n/4 (the mean of max(cos, 0) over the sphere is 1/4), so such frames reach three quarters
// of what one light head-on gives in `exposure`: as little noise as can be had without clipping.
core::Nanoseconds default_full_on_exposure(core::Nanoseconds exposure, std::size_t light_count);

// Dark frames, a full-on frame, then every light once in the order of its index, with tracking frames between
// and at both ends. Throws UsageError for no lights, negative counts, exposures not within (0, one hour], or one given twice.
Sequence make_olat_sequence(const OlatOptions& options);

// What the step lights: nothing, one light, all of them, or the step's own pattern. Throws BadInput naming
// the step for a light that is missing, listed twice or not one of `light_count`, and for a level outside [0,
// 1].
std::vector<LightLevel> levels(const db::Step& step, std::size_t light_count);

// Step::pattern for these levels: the inverse of levels(), exact.
std::string pattern_of(std::span<const LightLevel> levels);

// The step whose pose all others are aligned to: the tracking step nearest the middle of the sequence (the
// first full-on step where there is none; -1 where there is neither).
int key_step(const std::vector<db::Step>& steps);

// Two steps that light and expose alike; the index is not compared.
bool same_shot(const db::Step& a, const db::Step& b);

// TOML: a [[step]] each, runs of single lights with rising index as one ("lights = [first, last]"). Reading
// what was written gives the same sequence, to the nanosecond and bit. Reading throws BadInput with file and
// line for a light the stage does not have, an exposure outside (0, one hour], a level outside [0, 1], a
// sequence without steps or with more than a million.
std::string to_toml(const Sequence& sequence);
Sequence parse_sequence(std::string_view toml, const std::string& source_name, std::size_t light_count);
Sequence read_sequence(const std::filesystem::path& path, std::size_t light_count);

}  // namespace lightstage::capture
