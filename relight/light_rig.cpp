#include "relight/light_rig.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>

#include "core/config.h"
#include "core/error.h"
#include "core/file.h"
#include "core/foreign_path.h"
#include "core/printable.h"
#include "core/text.h"

namespace lightstage::relight {

namespace {

constexpr double kBrightest = 1e6;
constexpr double kLongestSeconds = 1e6;
constexpr int kMostFrames = 1000000;

using core::TomlTable;

double number_within(const TomlTable& table, std::string_view key, double lowest, double highest) {
  const double value = table.number(key);
  if (!(value >= lowest && value <= highest))
    table.fail(key, "must be " + core::number_text(lowest) + " to " + core::number_text(highest) + ", not " +
                        core::number_text(value));
  return value;
}

core::Direction direction_in(const TomlTable& table, std::string_view key) {
  const std::vector<double> numbers = table.numbers(key);
  try {
    if (numbers.size() == 3) return core::Direction::from_vector({numbers[0], numbers[1], numbers[2]});
    if (numbers.size() == 2) return core::Direction::from_longitude_latitude_degrees(numbers[0], numbers[1]);
  } catch (const core::BadInput& problem) {
    table.fail(key, std::string("is none: ") + problem.what());
  }
  table.fail(key, "must be [x, y, z] or [longitude, latitude] in degrees");
}

core::Vec3 colour_in(const TomlTable& table, std::string_view key) {
  const std::vector<double> rgb = table.numbers(key, 3);
  for (const double v : rgb)
    if (!(v >= 0 && v <= kBrightest))
      table.fail(key,
                 "must be three numbers of 0 to " + core::number_text(kBrightest) + ", not " + core::number_text(v));
  return {rgb[0], rgb[1], rgb[2]};
}

// How to read a number of a range, for animated().
auto number_from(double lowest, double highest) {
  return [=](const TomlTable& table, std::string_view key) { return number_within(table, key, lowest, highest); };
}

// The [[key]] tables of one light or environment, with their times.
struct Keys {
  std::vector<TomlTable> tables;
  std::vector<double> seconds;

  explicit Keys(const TomlTable& owner) : tables(owner.tables("key")) {
    for (const TomlTable& table : tables) {
      seconds.push_back(number_within(table, "time_s", 0, kLongestSeconds));
      if (seconds.size() > 1 && !(seconds.back() > seconds[seconds.size() - 2]))
        table.fail("time_s", "must be later than in the key before");
    }
  }

  double last_seconds() const { return seconds.empty() ? 0 : seconds.back(); }
};

// A value that stands in the table itself or in some of its keys; the default where it does neither.
template <class Value, class Read>
Track<Value> animated(const TomlTable& owner, const Keys& keys, std::string_view name, std::optional<Value> otherwise,
                      const Read& read) {
  std::vector<Keyframe<Value>> frames;
  for (std::size_t i = 0; i < keys.tables.size(); ++i) {
    const TomlTable& key = keys.tables[i];
    if (!key.has(name)) continue;
    if (owner.has(name)) key.fail(name, "is given for all times already; keep it there or in the keys");
    const Value value = read(key, name);
    if constexpr (std::is_same_v<Value, core::Direction>) {
      if (!frames.empty() && are_opposite(frames.back().value, value))
        key.fail(name, "is opposite to the one before it: put a key between them that says which way to go");
    }
    frames.push_back({keys.seconds[i], value});
  }
  if (!frames.empty()) return Track<Value>(std::move(frames));
  if (otherwise && !owner.has(name)) return *otherwise;
  return read(owner, name);
}

RigLight light_in(const TomlTable& table, const Keys& keys) {
  return {animated<core::Direction>(table, keys, "direction", std::nullopt, direction_in),
          animated<double>(table, keys, "radius_deg", 0.0, number_from(0, 180)),
          animated<core::Vec3>(table, keys, "colour", core::Vec3{1, 1, 1}, colour_in),
          animated<double>(table, keys, "intensity", 1.0, number_from(0, kBrightest))};
}

RigEnvironment environment_in(const TomlTable& table, const Keys& keys, const std::filesystem::path& folder) {
  const std::string file = table.string("file");
  if (file.empty()) table.fail("file", "must name a lat-long environment map");
  if (const auto objection = core::objection_to_name(folder, file)) {
    table.fail("file", "names " + core::quoted(file) + ", which " + *objection + " of the rig");
  }
  return {folder / file, animated<double>(table, keys, "rotate_deg", 0.0, number_from(-1e6, 1e6)),
          animated<double>(table, keys, "exposure_ev", 0.0, number_from(-60, 60))};
}

}  // namespace

AreaLight RigLight::at(double seconds) const {
  return {direction.at(seconds), radius_degrees.at(seconds), intensity.at(seconds) * colour.at(seconds)};
}

bool RigLight::is_fixed() const {
  return direction.is_fixed() && radius_degrees.is_fixed() && colour.is_fixed() && intensity.is_fixed();
}

LightRig LightRig::read(const std::filesystem::path& path) {
  return parse(core::read_text_file(path), path.string(), path.parent_path());
}

LightRig LightRig::parse(std::string_view text, const std::string& source_name, const std::filesystem::path& folder) {
  const TomlTable table = TomlTable::parse(text, source_name);
  LightRig rig;
  double last_seconds = 0;
  for (const TomlTable& light : table.tables("light")) {
    const Keys keys(light);
    rig.lights.push_back(light_in(light, keys));
    last_seconds = std::max(last_seconds, keys.last_seconds());
  }
  if (const auto environment = table.optional_table("environment")) {
    const Keys keys(*environment);
    rig.environment = environment_in(*environment, keys, folder);
    last_seconds = std::max(last_seconds, keys.last_seconds());
  }
  if (rig.lights.empty() && !rig.environment)
    table.fail("light", "is missing: a rig needs a [[light]] or an [environment]");
  if (table.has("fps")) rig.frames_per_second = number_within(table, "fps", 1e-3, 1e3);
  if (table.has("frames")) {
    const std::int64_t frames = table.integer("frames");
    if (frames < 1 || frames > kMostFrames)
      table.fail("frames", "must be 1 to " + std::to_string(kMostFrames) + ", not " + std::to_string(frames));
    rig.frames = int(frames);
  } else {
    // Up to the last key, which a rounding error must not lose.
    const double last_frame = std::floor(last_seconds * rig.frames_per_second + 1e-6);
    if (last_frame >= kMostFrames)
      table.fail("fps", "makes more than " + std::to_string(kMostFrames) + " frames up to the last key");
    rig.frames = 1 + int(last_frame);
  }
  table.finish();
  return rig;
}

RigFrame LightRig::frame(int index) const {
  const double seconds = index / frames_per_second;
  RigFrame frame;
  for (const RigLight& light : lights) (light.is_fixed() ? frame.fixed : frame.moving).push_back(light.at(seconds));
  if (environment)
    frame.environment = {environment->file, environment->rotate_degrees.at(seconds),
                         environment->exposure_stops.at(seconds)};
  return frame;
}

}  // namespace lightstage::relight
