#include "cli/relight/environment_options.h"

#include <cmath>
#include <cstdint>

#include <CLI/CLI.hpp>

#include "cli/options.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

constexpr double kDraft = 0.01, kGood = 0.002;  // DSSIM

double seconds_of(const std::string& text) {
  double unit = 1;
  std::string_view number = text;
  const auto strip = [&](std::string_view suffix, double seconds) {
    if (!number.ends_with(suffix)) return false;
    number.remove_suffix(suffix.size());
    unit = seconds;
    return true;
  };
  strip("min", 60) || strip("ms", 1e-3) || strip("s", 1) || strip("h", 3600);
  const std::optional<double> value = core::parse_number(core::trim(number));
  if (!value || !(*value > 0) || !(*value * unit <= 1e7))
    throw core::UsageError("--budget: '" + text + "' is not a time such as 20s, 2min or 0.5h");
  return *value * unit;
}

relight::Goal goal_of_quality(const std::string& quality) {
  if (quality == "exact") return relight::Exhaustive{};
  return relight::ErrorGoal{quality == "draft" ? kDraft : kGood};
}

}  // namespace

relight::Goal EnvironmentOptions::goal() const {
  const int goals = int(error.has_value()) + int(!budget.empty()) + int(!quality.empty()) + int(exhaustive);
  map_size();
  if (goals > 1) throw core::UsageError("give one of --error, --budget, --quality and --exhaustive");
  if (error) return relight::ErrorGoal{*error, measure};
  if (!budget.empty()) return relight::TimeGoal{seconds_of(budget)};
  return goal_of_quality(exhaustive ? "exact" : quality);
}

relight::Environment EnvironmentOptions::resized(relight::Environment environment) const {
  const auto [width, height] = map_size();
  return size.empty() ? environment : environment.resized(width, height);
}

std::pair<int, int> EnvironmentOptions::map_size() const {
  if (size.empty()) return {0, 0};
  const std::vector<std::string_view> sides = core::split(size, 'x');
  std::vector<int> pixels;
  for (const std::string_view side : sides) {
    const std::optional<double> value = core::parse_number(side);
    if (value && *value >= 1 && *value <= 32768 && *value == std::floor(*value)) pixels.push_back(int(*value));
  }
  if (sides.size() != 2 || pixels.size() != 2)
    throw core::UsageError("--size: '" + size + "' is not WIDTHxHEIGHT in pixels, such as 256x128");
  constexpr std::int64_t kMostPixels = 16384 * 8192;  // 1.6 GB
  if (std::int64_t(pixels[0]) * pixels[1] > kMostPixels)
    throw core::UsageError("--size: '" + size + "' is more than the " + std::to_string(kMostPixels) +
                           " pixels (16384x8192) that a map may have");
  return {pixels[0], pixels[1]};
}

ordered_json EnvironmentOptions::json() const {
  ordered_json json{{"size", size}};
  const relight::Goal asked = goal();
  if (const auto* within = std::get_if<relight::ErrorGoal>(&asked)) {
    json["error"] = within->error;
    json["measure"] = within->measure == relight::ErrorMeasure::kDssim ? "dssim" : "relative_rms";
  } else if (const auto* time = std::get_if<relight::TimeGoal>(&asked)) {
    json["budget_s"] = time->seconds;
  } else {
    json["exhaustive"] = true;
  }
  return json;
}

void add_environment_options(CLI::App& command, EnvironmentOptions& options) {
  command
      .add_option("--error", options.error,
                  "Environments: the error from the exhaustive answer that may stay; so few pictures are synthesised")
      ->check(number_between(1e-9, 1.0));
  const std::map<std::string, relight::ErrorMeasure> measures{{"dssim", relight::ErrorMeasure::kDssim},
                                                              {"rms", relight::ErrorMeasure::kRelativeRms}};
  command
      .add_option(
          "--error-measure", options.measure,
          "What --error counts: dssim, of the picture as it is shown, or rms, the root mean square of the linear "
          "difference over the picture's [dssim]")
      ->transform(one_of(measures));
  command.add_option("--budget", options.budget, "Environments: the best in so much time, such as 20s or 2min");
  command
      .add_option("--quality", options.quality,
                  "Environments: draft (DSSIM 0.01), good (0.002) or exact, the exhaustive answer [good]")
      ->check(CLI::IsMember({"draft", "good", "exact"}).description(""));
  command.add_flag("--exhaustive", options.exhaustive,
                   "Environments: a synthesised picture for every lit pixel of the map, the reference for all else");
  command.add_option("--size", options.size, "Bring the map to this size first, such as 256x128 [as it is]");
}

ordered_json plan_json(const relight::Plan& plan) {
  ordered_json lights = ordered_json::array();
  for (const relight::DistantLight& light : plan.synthesised)
    lights.push_back({{"direction", {light.direction.x(), light.direction.y(), light.direction.z()}},
                      {"irradiance", {light.irradiance.x, light.irradiance.y, light.irradiance.z}}});
  return {{"represented", plan.synthesised.size()},
          {"sampled", plan.remainder.size()},
          {"dssim_estimate", plan.expected_error(relight::ErrorMeasure::kDssim)},
          {"relative_rms_estimate", plan.expected_error(relight::ErrorMeasure::kRelativeRms)},
          {"lights", lights}};
}

}  // namespace lightstage::cli
