// What is lit and shot, step by step.
#pragma once

#include <cstddef>
#include <filesystem>
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

struct Sequence {
  std::vector<db::Step> steps;
  core::Nanoseconds settle = 2 * core::kMillisecond;  // from switching lights to the trigger
};

struct OlatOptions {
  std::size_t light_count = 0;
  int tracking_every = 10;   // a tracking frame before every n-th light and one at the end; 0 for none
  int dark_frames = 3;       // at the start
  bool full_on = true;       // one full-on frame after the dark ones
  core::Nanoseconds exposure = 20 * core::kMillisecond;           // of the single lights
  core::Nanoseconds full_on_exposure = core::kMillisecond;        // of full-on and tracking frames
};

// Dark frames, a full-on frame, then every light once in the order of its index, with tracking frames between and at both ends.
Sequence make_olat_sequence(const OlatOptions& options);

// What the step lights: nothing, one light, all of them, or the step's own pattern.
std::vector<LightLevel> levels(const db::Step& step, std::size_t light_count);

// The step whose pose all others are aligned to: the tracking step nearest the middle of the sequence (the first full-on step
// where there is none; -1 where there is neither).
int key_step(const std::vector<db::Step>& steps);

// TOML: runs of light steps are written as ranges, everything else as [[step]]. Reading what was written gives the same sequence.
// Reading throws BadInput with file and line for a light the stage does not have, an exposure that is not positive, a level
// outside [0, 1].
std::string to_toml(const Sequence& sequence);
Sequence parse_sequence(std::string_view toml, const std::string& source_name, std::size_t light_count);
Sequence read_sequence(const std::filesystem::path& path, std::size_t light_count);

}  // namespace lightstage::capture
