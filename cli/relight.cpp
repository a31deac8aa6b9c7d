#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/method_options.h"
#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "cli/relight/explain.h"
#include "cli/relight/make_pictures.h"
#include "cli/relight/picture_method.h"
#include "core/error.h"
#include "core/stopwatch.h"
#include "core/text.h"
#include "model/peak_memory.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  std::string name;
  LightOptions light;
  FrameOptions frames;
  std::optional<double> exposure_stops;
  bool explain = false;
  std::filesystem::path out;
  MethodChoice method;
};

std::size_t picture_count(const std::vector<Sequence>& all) {
  std::size_t count = 0;
  for (const Sequence& sequence : all) count += std::size_t(sequence.rig.frames);
  return count;
}

// A folder protects what is in it; a file with a name of its own is written over.
void require_no_input(const PicturePlace& place, const std::vector<Sequence>& all) {
  for (const Sequence& sequence : all) {
    if (place.is_folder() || !sequence.rig.environment) continue;
    const relight::WrittenPicture written = relight::picture_files(place.path());
    for (const std::filesystem::path& file : {written.exr, written.png}) {
      std::error_code not_there;
      if (std::filesystem::equivalent(file, sequence.rig.environment->file, not_there))
        throw core::UsageError("--out: '" + file.string() + "' is the environment itself");
    }
  }
}

// What a frame took, and for environments how far from the exhaustive answer it is expected to be.
ordered_json work_json(const FramePicture& work, relight::ErrorMeasure measure) {
  ordered_json json{{"directions_synthesised", work.directions_synthesised}, {"seconds", work.seconds}};
  if (!work.environment) return json;
  const relight::EnvironmentReport& report = *work.environment;
  json["directions_exhaustive"] = report.directions_exhaustive;
  json["directions_captured"] = report.directions_captured;
  json["error_estimate"] = measure == relight::ErrorMeasure::kDssim ? report.dssim_estimate : report.rms_estimate;
  json["plan"] = plan_json(report.plan);
  json["plan"]["seconds_planning"] = report.seconds_planning;
  json["plan"]["seconds_synthesising"] = report.seconds_synthesising;
  json["plan"]["seconds_summing"] = report.seconds - report.seconds_planning - report.seconds_synthesising;
  return json;
}

ordered_json frame_json(const MadePicture& picture, relight::ErrorMeasure measure) {
  ordered_json json{{"file", picture.files.exr.string()},
                    {"png", picture.files.png.string()},
                    {"stops", picture.stops},
                    {"already_made", picture.already_made}};
  json.update(work_json(picture.work, measure));
  return json;
}

// What was asked, what is kept, and where the time went.
std::string environment_text(const FramePicture& work, const EnvironmentOptions& options) {
  if (!work.environment) return "";
  const relight::EnvironmentReport& report = *work.environment;
  std::string text = "  the map has " + std::to_string(report.directions_exhaustive) + " lit pixels; " +
                     std::to_string(report.directions_captured) + " captured and " +
                     std::to_string(report.directions_synthesised) + " synthesised pictures were summed\n";
  const bool is_linear = report.plan.picture_rms == 0 && report.directions_synthesised == 0;
  if (is_linear) return text + "  this method has no more to say of any light: nothing is left out\n";
  const relight::Goal goal = options.goal();
  if (const auto* error = std::get_if<relight::ErrorGoal>(&goal)) {
    text += "  asked: " + std::string(error->measure == relight::ErrorMeasure::kDssim ? "DSSIM" : "relative RMS") +
            " " + core::number_text(error->error) + " from the exhaustive answer; ";
  } else if (const auto* time = std::get_if<relight::TimeGoal>(&goal)) {
    text += "  asked: " + core::number_text(time->seconds) + " s; ";
  } else {
    text += "  asked: the exhaustive answer; ";
  }
  return text + "expected: DSSIM " + core::number_text(report.dssim_estimate, 2) + ", relative RMS " +
         core::number_text(report.rms_estimate, 2) + "\n  planning " + fixed(report.seconds_planning, 2) +
         " s, synthesis " + fixed(report.seconds_synthesising, 2) + " s, summing " +
         fixed(report.seconds - report.seconds_planning - report.seconds_synthesising, 2) + " s\n";
}

std::string source_text(const PictureMethod& method, const FramePicture& work) {
  if (!method.pack() && work.directions_synthesised == 0) return "captured pictures alone";
  if (!method.pack())
    return std::to_string(work.directions_synthesised) +
           (work.directions_synthesised == 1 ? " synthesised picture" : " synthesised pictures");
  return std::to_string(method.pack()->rank) + " basis pictures (error " +
         core::number_text(method.pack()->errors.relative, 2) + ")";
}

// Of pictures under one environment or rig it is one exposure.
std::string stops_text(const std::vector<MadePicture>& pictures) {
  const auto [least, most] = std::minmax_element(
      pictures.begin(), pictures.end(), [](const MadePicture& a, const MadePicture& b) { return a.stops < b.stops; });
  const std::string low = fixed(least->stops, 2), high = fixed(most->stops, 2);
  return (low == high ? low : low + " to " + high) + " stops";
}

void report(const Options& options, const PictureMethod& method, double preparing_seconds, const PicturePlace& place,
            const std::vector<MadePicture>& pictures, std::optional<std::size_t> peak_bytes, const Context& context) {
  const relight::ErrorMeasure measure = options.frames.environment.measure;
  const MadePicture &first = pictures.front(), &last = pictures.back();
  std::size_t already_made = 0;
  FramePicture all;
  ordered_json frames = ordered_json::array();
  for (const MadePicture& picture : pictures) {
    already_made += picture.already_made ? 1 : 0;
    all.directions_synthesised += picture.work.directions_synthesised;
    all.seconds += picture.work.seconds;
    frames.push_back(frame_json(picture, measure));
  }
  const bool several = pictures.size() > 1;
  std::string text;
  if (already_made < pictures.size())
    text = "relit '" + options.name + "' by " + method.name() + " from " + source_text(method, all) + " in " +
           fixed(all.seconds, 2) + " s\n";
  if (!several) text += environment_text(first.work, options.frames.environment);
  if (already_made > 0)
    text +=
        "there already: " + std::to_string(already_made) + " of " + core::counted(pictures.size(), "picture") + "\n";
  text += std::string(first.already_made ? "" : "wrote ") +
          (several ? core::counted(pictures.size(), "picture") + ", " : "") + first.files.exr.string() +
          (several ? " to " + last.files.exr.string() + ", each with its .png" : " and " + first.files.png.string()) +
          " (" + stops_text(pictures) + ")\n";
  ordered_json json{{"scan", options.name}, {"method", method.name()}};
  json.update(several ? work_json(all, measure) : work_json(first.work, measure));
  if (method.pack()) json["pack"] = to_json(*method.pack());
  json["seconds_preparing"] = preparing_seconds;
  json["peak_rss_bytes"] = or_null(peak_bytes);
  json["stops"] = first.stops;
  json["exr"] = first.files.exr.string();
  json["png"] = first.files.png.string();
  if (place.is_folder()) {
    json["already_made"] = already_made;
    json["frames"] = frames;
  }
  context.result(text, json);
}

bool has_environment(const std::vector<Sequence>& all) {
  return std::any_of(all.begin(), all.end(), [](const Sequence& s) { return s.rig.environment.has_value(); });
}

void run_relight(const Options& options, Context& context) {
  // What is wrong with the command line is said before a large scan is read.
  std::vector<Sequence> all = sequences(options.light);
  options.frames.environment.goal();
  if (!has_environment(all) && (options.explain || options.frames.environment.given()))
    throw core::UsageError("--error, --budget, --quality, --exhaustive, --size and --explain are for environments");
  if (options.explain) {
    explain(all, options.frames.environment, options.method, options.name, context);
    return;
  }
  if (options.out.empty()) throw core::UsageError("--out is missing: where should the picture go?");
  const PicturePlace place(options.out, picture_count(all));
  require_no_input(place, all);
  if (options.frames.samples &&
      std::all_of(all.begin(), all.end(), [](const Sequence& s) { return s.rig.lights.empty(); }))
    throw core::UsageError("--samples is for area lights, and there is no light");
  db::Store store = context.open_store();
  store.require_writable();
  const db::Scan scan = store.scan(options.name);
  const PictureMethod method(options.method, store, scan, has_environment(all));
  const db::LoadedScan source = load_scan(store, options.name);

  const model::PeakMemory memory;
  std::vector<PictureJob> jobs;
  for (Sequence& sequence : all) {
    Recipe recipe(sequence.rig, method, options.frames, options.exposure_stops);
    jobs.push_back({std::move(sequence), std::move(recipe), options.exposure_stops});
  }
  PictureFiles files(store, scan, method.inputs(source), place.folder());
  find_made_pictures(jobs, place, files);
  double preparing_seconds = 0;
  const std::vector<MadePicture> pictures = make_pictures(jobs, place, files, options.frames, source.scan.mask(), [&] {
    const core::Stopwatch stopwatch;
    auto interpolator = method.interpolator(store, source);
    preparing_seconds = stopwatch.seconds();
    return interpolator;
  });
  report(options, method, preparing_seconds, place, pictures, memory.bytes(), context);
}

}  // namespace

void add_relight(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand(
      "relight", "Pictures of the subject under lights, environments or a rig of both, one or a sequence of them");
  command->footer(
      "Examples:\n"
      "  lightstage relight head --light 0.3,0.5,0.8 --out key.exr\n"
      "  lightstage relight head --light 40,20 --radius 10 --out soft.exr      (longitude,latitude in degrees)\n"
      "  lightstage relight head --light 40,20 --radius 8 --colour 1,0.9,0.7 --light -70,10 --radius 2 --colour "
      "0.2,0.3,0.6 --out two.exr\n"
      "  lightstage relight head --env venice.hdr --out venice.exr             (DSSIM 0.002 from the exhaustive "
      "answer)\n"
      "  lightstage relight head --env venice.hdr --budget 5s --out quick.exr\n"
      "  lightstage relight head --env venice.hdr --error 0.0005 --explain\n"
      "  lightstage relight head --env venice.hdr --turn 48 --out turn/        (turn/venice_0000.exr ...)\n"
      "  lightstage relight head --rig moving.toml --out frames/\n"
      "The same command goes on with a folder of pictures where it was interrupted.");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  add_light_options(*command, options->light);
  command
      ->add_option("--samples", options->frames.samples,
                   "Directions that stand for an area light [as many as its radius and the stage need]")
      ->check(CLI::Range(1, 100000));
  add_environment_options(*command, options->frames.environment);
  command->add_flag("--explain", options->explain,
                    "Environments: only tell what would be synthesised, from which lights, and what it would take");
  command
      ->add_option("--exposure", options->exposure_stops,
                   "Stops for the PNGs [so that the bright parts of a sequence's first picture just fit]")
      ->check(number_between(-60, 60));
  command->add_option("--out", options->out,
                      "The .exr to write; for several pictures a folder (end it in /). A .png comes beside each");
  add_method_options(*command, options->method,
                     std::string(kOneMethod) + " or, where `superres --compress` packed the scan, its `pack`");
  command->callback([options, &context] { run_relight(*options, context); });
}

}  // namespace lightstage::cli
