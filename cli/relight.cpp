#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/method_options.h"
#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "cli/relight/make_pictures.h"
#include "core/error.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  std::string name;
  LightOptions light;
  FrameOptions frames;
  std::optional<double> exposure_stops;
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
    std::error_code not_there;
    if (sequence.rig.environment &&
        std::filesystem::equivalent(place.path(), sequence.rig.environment->file, not_there))
      throw core::UsageError("--out: '" + place.path().string() + "' is the environment itself");
  }
}

ordered_json frame_json(const MadePicture& picture) {
  return {{"file", picture.files.exr.string()},
          {"png", picture.files.png.string()},
          {"stops", picture.stops},
          {"already_made", picture.already_made},
          {"directions_synthesised", picture.directions_synthesised},
          {"seconds", picture.seconds}};
}

void report(const Options& options, const std::string& method, const PicturePlace& place,
            const std::vector<MadePicture>& pictures, const Context& context) {
  const MadePicture &first = pictures.front(), &last = pictures.back();
  std::size_t already_made = 0, directions_synthesised = 0;
  double seconds = 0;
  ordered_json frames = ordered_json::array();
  for (const MadePicture& picture : pictures) {
    already_made += picture.already_made ? 1 : 0;
    directions_synthesised += picture.directions_synthesised;
    seconds += picture.seconds;
    frames.push_back(frame_json(picture));
  }
  const bool several = pictures.size() > 1;
  std::string text;
  if (already_made < pictures.size())
    text = "relit '" + options.name + "' by " + method + " from " + std::to_string(directions_synthesised) +
           " synthesised pictures in " + fixed(seconds, 2) + " s\n";
  if (already_made > 0)
    text += std::to_string(already_made) + " of " + std::to_string(pictures.size()) + " pictures were there already\n";
  text += std::string(first.already_made ? "" : "wrote ") + first.files.exr.string() +
          (several ? " to " + last.files.exr.string() + ", each with its .png" : " and " + first.files.png.string()) +
          " (" + fixed(first.stops, 2) + " stops)\n";
  ordered_json json{{"scan", options.name},
                    {"method", method},
                    {"directions_synthesised", directions_synthesised},
                    {"seconds", seconds},
                    {"stops", first.stops},
                    {"exr", first.files.exr.string()},
                    {"png", first.files.png.string()}};
  if (place.is_folder()) {
    json["already_made"] = already_made;
    json["frames"] = frames;
  }
  context.result(text, json);
}

void run_relight(const Options& options, Context& context) {
  // What is wrong with the command line is said before a large scan is read.
  std::vector<Sequence> all = sequences(options.light);
  const PicturePlace place(options.out, picture_count(all));
  require_no_input(place, all);
  if (options.frames.samples &&
      std::all_of(all.begin(), all.end(), [](const Sequence& s) { return s.rig.lights.empty(); }))
    throw core::UsageError("--samples is for area lights, and there is no light");
  db::Store store = context.open_store();
  store.require_writable();
  const db::Scan scan = store.scan(options.name);
  MethodChoice choice = resolve(options.method, store, scan.id);
  if (std::any_of(all.begin(), all.end(), [](const Sequence& s) { return s.rig.environment.has_value(); })) {
    // It is a sum of very many lights, and light adds up linearly: display values would not.
    choice.options.domain = model::Domain::kLinear;
    choice.knobs["--domain"] = "linear";
  }
  const db::LoadedScan source = load_scan(store, options.name);

  std::vector<PictureJob> jobs;
  for (Sequence& sequence : all) {
    Recipe recipe(sequence.rig, choice, options.frames, options.exposure_stops);
    jobs.push_back({std::move(sequence), std::move(recipe), options.exposure_stops});
  }
  PictureFiles files(store, scan, source, place.folder());
  find_made_pictures(jobs, place, files);
  const std::vector<MadePicture> pictures = make_pictures(jobs, place, files, options.frames, source.scan.mask(), [&] {
    return model::make_interpolator(choice.method, source.scan, choice.options);
  });
  report(options, choice.method, place, pictures, context);
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
      "  lightstage relight head --env venice.hdr --method linear --out venice.exr\n"
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
  command
      ->add_option("--virtual-lights", options->frames.environment.virtual_lights,
                   "Directions that stand for an environment, for methods that are not linear in the captured pictures")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  command
      ->add_option("--exposure", options->exposure_stops,
                   "Stops for the PNGs [so that the bright parts of a sequence's first picture just fit]")
      ->check(number_between(-60, 60));
  command
      ->add_option("--out", options->out,
                   "The .exr to write; for several pictures a folder (end it in /). A .png comes beside each")
      ->required();
  add_method_options(*command, options->method, kOneMethod);
  command->callback([options, &context] { run_relight(*options, context); });
}

}  // namespace lightstage::cli
