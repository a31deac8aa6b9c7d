#include "cli/relight/explain.h"

#include <algorithm>

#include "cli/format.h"
#include "cli/jobs/environments.h"
#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "cli/relight/picture_method.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/sphere.h"
#include "core/stopwatch.h"
#include "core/text.h"
#include "model/peak_memory.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

constexpr std::size_t kLightsNamed = 8;  // nearest to each that is synthesised
constexpr std::size_t kRowsShown = 20;   // of a plan that may have thousands; --json has them all

// The first picture also loads what the others share, the second shows what one takes.
double expected_synthesis_seconds(const relight::Plan& plan, const model::LightInterpolator& interpolator) {
  if (plan.pictures() == 0) return 0;
  const core::Direction direction =
      (plan.synthesised.empty() ? plan.remainder.front() : plan.synthesised.front()).direction;
  const core::Stopwatch first;
  interpolator.render(direction);
  const double once_prepared = first.seconds();
  const core::Stopwatch second;
  interpolator.render(direction);
  return once_prepared + double(plan.pictures() - 1) * second.seconds();
}

std::string time_text(double seconds) {
  return seconds < 100 ? fixed(seconds, 1) + " s" : fixed(seconds / 60, 1) + " min";
}

// Those whose environment stands otherwise than in the frame before: the others take its picture.
std::vector<int> frames_to_plan(const relight::LightRig& rig) {
  std::vector<int> frames{0};
  for (int number = 1; number < rig.frames; ++number) {
    if (rig.frame(number).environment->rotate_degrees != rig.frame(number - 1).environment->rotate_degrees)
      frames.push_back(number);
  }
  return frames;
}

std::string summary_text(const relight::Plan& plan, const std::string& file, std::size_t captured,
                         const std::string& method, double seconds) {
  std::string text = file + ": " + std::to_string(captured) + " captured pictures, and " +
                     std::to_string(plan.synthesised.size()) + " synthesised by " + method;
  if (!plan.remainder.empty()) text += " and " + std::to_string(plan.remainder.size()) + " as samples of the rest";
  return text + "; about " + time_text(seconds) + "; expected: DSSIM " +
         core::number_text(plan.expected_error(relight::ErrorMeasure::kDssim), 2) + ", relative RMS " +
         core::number_text(plan.expected_error(relight::ErrorMeasure::kRelativeRms), 2) + "\n";
}

// Adds to `json` by which captured lights each synthesised one stands, and returns the same as a table.
std::string name_neighbours(const relight::Plan& plan, const std::vector<core::Direction>& captured,
                            ordered_json& json) {
  std::vector<std::vector<std::string>> rows{{"longitude, latitude", "irradiance r g b", "nearest captured lights"}};
  for (std::size_t i = 0; i < plan.synthesised.size(); ++i) {
    const relight::DistantLight& light = plan.synthesised[i];
    const std::vector<std::size_t> nearest = core::nearest_indices(captured, light.direction, kLightsNamed);
    json["lights"][i]["nearest_captured"] = nearest;
    if (i >= kRowsShown) continue;
    std::string names;
    for (const std::size_t index : nearest) names += (names.empty() ? "" : " ") + std::to_string(index);
    const core::Vec3 rgb = light.irradiance;
    rows.push_back({fixed(light.direction.longitude_degrees(), 1) + ", " + fixed(light.direction.latitude_degrees(), 1),
                    core::number_text(rgb.x, 3) + " " + core::number_text(rgb.y, 3) + " " + core::number_text(rgb.z, 3),
                    names});
  }
  if (rows.size() == 1) return "";
  const std::size_t more = plan.synthesised.size() - std::min(plan.synthesised.size(), kRowsShown);
  return table(rows) + (more > 0 ? "and " + std::to_string(more) + " more: --json lists them all\n" : "");
}

}  // namespace

void explain(const std::vector<Sequence>& all, const EnvironmentOptions& asked, const MethodChoice& choice,
             const std::string& scan, Context& context) {
  const relight::Goal goal = asked.goal();
  const auto* error = std::get_if<relight::ErrorGoal>(&goal);
  if (!error) throw core::UsageError("--explain tells the plan for an error: give --error, or --quality draft or good");
  const db::Store store = context.open_store();
  const PictureMethod method(choice, store, store.scan(scan), /*linear_light=*/true);
  const db::LoadedScan source = load_scan(store, scan);
  const model::PeakMemory memory;
  const auto interpolator = method.interpolator(store, source);
  const relight::EnvironmentRelighter relighter(*interpolator);
  std::string text;
  ordered_json plans = ordered_json::array();
  double all_seconds = 0;
  for (const Sequence& sequence : all) {
    if (!sequence.rig.environment) continue;
    const std::string file = sequence.rig.environment->file.string();
    const relight::Environment whole = asked.resized(read_environment(file));
    const std::vector<int> frames = frames_to_plan(sequence.rig);
    for (const int number : frames) {
      core::throw_if_interrupted();
      const double rotation = sequence.rig.frame(number).environment->rotate_degrees;
      const core::Stopwatch planning;
      const relight::Plan plan = relighter.plan(whole.rotated(rotation), *error);
      const double seconds = planning.seconds() + expected_synthesis_seconds(plan, *interpolator);
      all_seconds += seconds;
      ordered_json json{{"environment", file}, {"frame", number}, {"rotate_deg", rotation}, {"method", method.name()}};
      json.update(plan_json(plan));
      json["directions_synthesised"] = plan.pictures();
      json["expected_seconds"] = seconds;
      json["expected_error"] = plan.expected_error(error->measure);
      json["peak_rss_bytes"] = or_null(memory.bytes());
      const std::string lights = name_neighbours(plan, source.scan.directions(), json);
      const bool one = frames.size() == 1;
      text += summary_text(plan, one ? file : file + ", frame " + std::to_string(number), source.scan.light_count(),
                           method.name(), seconds) +
              (one ? lights : "");
      plans.push_back(std::move(json));
    }
  }
  if (plans.size() > 1) text += "in all about " + time_text(all_seconds) + "\n";
  context.result(text, {{"scan", scan}, {"plans", plans}, {"expected_seconds", all_seconds}});
}

}  // namespace lightstage::cli
