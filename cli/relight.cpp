#include <CLI/CLI.hpp>
#include <chrono>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/light_pack.h"
#include "cli/jobs/method_options.h"
#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/progress.h"
#include "db/content_hash.h"
#include "relight/picture.h"
#include "relight/relight.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string name;
  std::string light;
  double radius_degrees = 0;
  int samples = 64;
  std::filesystem::path environment;
  double rotate_degrees = 0;
  std::size_t virtual_lights = 512;
  std::optional<double> exposure_stops;
  std::filesystem::path out;
  MethodChoice method;
};

relight::RelightReport relit(const Options& options, const std::optional<core::Direction>& light,
                             const model::LightInterpolator& interpolator) {
  if (light) {
    return options.radius_degrees > 0
               ? relight::relight_area(interpolator, *light, options.radius_degrees, options.samples)
               : relight::relight_direction(interpolator, *light);
  }
  const relight::Environment environment = relight::Environment::read(options.environment);
  if (environment.negative_values() > 0) {
    core::warn(options.environment.string() + ": " + std::to_string(environment.negative_values()) +
               " negative values count as 0");
  }
  return relight::relight_environment(
      interpolator, options.rotate_degrees == 0 ? environment : environment.rotated(options.rotate_degrees),
      options.virtual_lights);
}

void run_relight(const Options& options, Context& context) {
  if (options.light.empty() == options.environment.empty()) {
    throw core::UsageError("give one light: --light x,y,z, or --env FILE");
  }
  // What is wrong with the command line is said before a large scan is read.
  std::optional<core::Direction> light;
  if (!options.light.empty()) light = direction_option("--light", options.light);
  if (options.out.extension() != ".exr")
    throw core::UsageError("--out: '" + options.out.string() + "' must end in .exr");
  db::Store store = context.open_store();
  const db::Scan scan = store.scan(options.name);
  const bool by_pack = takes_pack(options.method, store, scan);
  MethodChoice choice = by_pack ? MethodChoice{.method = "pack"} : resolve(options.method, store, scan.id);
  if (!options.environment.empty()) {
    // It is a sum of very many lights, and light adds up linearly: display values would not.
    choice.options.domain = model::Domain::kLinear;
    choice.knobs["--domain"] = "linear";
  }
  const db::LoadedScan source = load_scan(store, options.name);
  const auto loading = std::chrono::steady_clock::now();
  const std::optional<PackInfo> pack = by_pack ? find_pack(store, scan.id) : std::nullopt;
  const std::unique_ptr<model::LightInterpolator> interpolator =
      by_pack ? load_pack(store, source, scan.id)
              : model::make_interpolator(choice.method, source.scan, choice.options);
  const double load_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - loading).count();
  const relight::RelightReport report = relit(options, light, *interpolator);

  const double stops = options.exposure_stops.value_or(relight::auto_exposure_stops(report.image, source.scan.mask()));
  const relight::WrittenPicture written = relight::write_picture(options.out, report.image, stops);

  db::NewProduct picture;
  picture.kind = "picture";
  picture.scan_id = scan.id;
  picture.input_scans = {scan.id};
  picture.input_products = source.products();
  if (pack) picture.input_products.push_back(pack->id);
  picture.parameters = json_text(
      {{"light", options.light},
       {"radius_deg", options.radius_degrees},
       {"environment", options.environment.string()},
       {"environment_hash", options.environment.empty() ? "" : db::hash_file(options.environment).hex()},
       {"rotate_deg", options.rotate_degrees},
       {"samples", options.samples},
       {"virtual_lights", options.virtual_lights},
       {"method", choice.method},
       {"knobs", by_pack ? nlohmann::ordered_json::object() : knob_values(choice)},
       {"model", choice.options.model_file.string()},
       {"model_hash", choice.options.model_file.empty() ? "" : db::hash_file(choice.options.model_file).hex()},
       {"stops", stops},
       {"file", std::filesystem::absolute(written.exr).string()}});
  store.add_product(picture);
  const std::string from =
      pack ? std::to_string(pack->rank) + " basis pictures (error " + fixed(pack->errors.relative, 5) + ")"
           : std::to_string(report.directions_synthesised) + " synthesised pictures";
  nlohmann::ordered_json json{{"scan", options.name},
                              {"method", choice.method},
                              {"directions_synthesised", report.directions_synthesised},
                              {"seconds", report.seconds},
                              {"stops", stops},
                              {"exr", written.exr.string()},
                              {"png", written.png.string()}};
  if (pack) {
    json["pack"] = to_json(*pack);
    json["pack"]["load_seconds"] = load_seconds;
  }
  context.result("relit '" + options.name + "' by " + choice.method + " from " + from + " in " +
                     fixed(report.seconds, 2) + " s\nwrote " + written.exr.string() + " and " + written.png.string() +
                     " (" + fixed(stops, 2) + " stops)\n",
                 json);
}

}  // namespace

void add_relight(CLI::App& program, Context& context) {
  CLI::App* command =
      program.add_subcommand("relight", "A picture of the subject under a light, an area light or an environment");
  command->footer(
      "Examples:\n"
      "  lightstage relight head --light 0.3,0.5,0.8 --out key.exr\n"
      "  lightstage relight head --light 40,20 --radius 10 --out soft.exr      (longitude,latitude in degrees)\n"
      "  lightstage relight head --env venice.hdr --method linear --out venice.exr\n"
      "  lightstage relight head-dense --env venice.hdr --out venice.exr       (by the pack of superres --compress)");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  command->add_option("--light", options->light, "Direction to the light: x,y,z or longitude,latitude in degrees");
  command->add_option("--radius", options->radius_degrees, "Angular radius of the light, degrees")
      ->capture_default_str()
      ->check(number_between(0.0, 180.0));
  command->add_option("--samples", options->samples, "Directions that stand for an area light")
      ->capture_default_str()
      ->check(CLI::Range(1, 100000));
  command->add_option("--env", options->environment, "Lat-long environment map (EXR or HDR)");
  command->add_option("--rotate", options->rotate_degrees, "Turn the environment about the vertical, degrees")
      ->capture_default_str();
  command
      ->add_option("--virtual-lights", options->virtual_lights,
                   "Directions that stand for an environment, for methods that are not linear in the captured pictures")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  command->add_option("--exposure", options->exposure_stops, "Stops for the PNG [so that the bright parts just fit]")
      ->check(number_between(-60, 60));
  command->add_option("--out", options->out, "The .exr to write; a .png comes beside it")->required();
  add_method_options(*command, options->method,
                     std::string(kOneMethod) + " or, where `superres --compress` packed the scan, its `pack`");
  command->callback([options, &context] { run_relight(*options, context); });
}

}  // namespace lightstage::cli
