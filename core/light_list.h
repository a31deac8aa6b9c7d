// Lists of named lights: RTI .lp files, and lights with what is known of them.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/direction.h"

namespace lightstage::core {

// One light of a stage as calibrated (or as nominal, or as imported).
struct Light {
  Direction direction;           // at stage centre, stage frame
  std::optional<Vec3> position;  // metres, stage frame, where known
  // Irradiance at stage centre in units of pi: a white Lambertian surface facing the light has radiance
  // `gain`.
  std::array<double, 3> gain{1, 1, 1};
};

// A line of an .lp file: a picture (or a light's name) and a direction.
struct LpEntry {
  std::string name;
  Direction direction;
};

// Reads "count, then `name x y z` a line" (RTI .lp, same axes as the stage frame). Names may hold spaces.
// Throws BadInput with file and line for a missing file, a wrong count, a line that does not parse, a zero or
// non-finite direction.
std::vector<LpEntry> read_lp(const std::filesystem::path& path);

// Writes an .lp file atomically, with 9 significant digits.
void write_lp(const std::filesystem::path& path, const std::vector<LpEntry>& entries);

}  // namespace lightstage::core
