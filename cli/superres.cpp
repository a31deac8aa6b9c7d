#include <CLI/CLI.hpp>
#include <chrono>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/light_pack.h"
#include "cli/jobs/method_options.h"
#include "cli/jobs/scans.h"
#include "cli/jobs/superres.h"
#include "cli/jobs/train.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/foreign_path.h"
#include "core/progress.h"
#include "core/text.h"
#include "core/version.h"
#include "db/content_hash.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string name, out;
  std::size_t lights = 1024;
  std::optional<double> adapt_minutes;
  bool compress = false;
  double compress_error = 0.01;
  MethodChoice method;
};

// Trains the chosen network further on this very scan, or goes on where an earlier command was interrupted in that. The result stays in the store,
// where other commands find it.
void adapt(db::Store& store, const std::string& scan, const MethodChoice& choice, double minutes,
           const std::filesystem::path& out) {
  if (choice.options.model_file.empty()) throw core::UsageError("--adapt: method " + choice.method + " is no network");
  std::error_code error;
  std::filesystem::create_directories(out.parent_path(), error);
  if (error) throw core::StoreError(out.parent_path().string() + ": cannot be made: " + error.message());
  model::TrainOptions options;
  options.config = model::read_checkpoint_info(choice.options.model_file).config;
  options.start_from = choice.options.model_file;
  options.minutes = minutes;
  options.crop = 128;
  if (std::filesystem::exists(out)) {
    options.resume = out;
  } else {
    std::filesystem::remove(model::last_checkpoint_path(out), error);  // of a run that was killed as it began
  }
  train_on_scans(store, {scan}, options, out);
}

std::uintmax_t bytes_of_frames(const db::Store& store, db::Id scan_id) {
  std::uintmax_t bytes = 0;
  for (const db::Frame& frame : store.frames(scan_id))
    bytes += std::filesystem::file_size(store.object_path(frame.object));
  return bytes;
}

// The pack that the scan has, if it is sound and what is asked for.
std::optional<PackInfo> sound_pack(const db::Store& store, const db::LoadedScan& scan, db::Id scan_id, double error) {
  try {
    auto pack = find_pack(store, scan_id);
    if (!pack || pack->asked_error != error) return std::nullopt;
    load_pack(store, scan, scan_id);
    return pack;
  } catch (const core::StoreError& broken) {
    core::warn(std::string(broken.what()) + " (which is done now)");
    return std::nullopt;
  }
}

// Packs the virtual scan, unless it is packed like that already.
nlohmann::ordered_json pack_scan(db::Store& store, const std::string& name, double error, double exposure) {
  const db::LoadedScan scan = load_scan(store, name);
  const db::Id id = store.scan(name).id;
  const auto start = std::chrono::steady_clock::now();
  std::optional<PackInfo> pack = sound_pack(store, scan, id, error);
  const bool already_stored = pack.has_value();
  if (!pack) pack = store_pack(store, scan, id, relight::compress(scan.scan, error, exposure), error);
  if (pack->errors.relative > error)
    core::warn("the pack's error is " + fixed(pack->errors.relative, 5) + ", over the " + fixed(error, 5) +
               " asked for");
  nlohmann::ordered_json json = to_json(*pack);
  json["scan_bytes"] = bytes_of_frames(store, id);
  json["already_stored"] = already_stored;
  json["seconds"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return json;
}

std::string text_of_pack(const nlohmann::ordered_json& pack) {
  const auto megabytes = [&](const char* key) { return fixed(double(pack.at(key)) / 1e6, 1) + " MB"; };
  return "packed: " + std::to_string(pack.at("rank").get<std::size_t>()) + " basis pictures, " + megabytes("bytes") +
         " beside " + megabytes("scan_bytes") + "; error " + fixed(pack.at("error"), 5) + ", of the worst light " +
         fixed(pack.at("largest_light_error"), 5) + ", display-encoded " + fixed(pack.at("display_error"), 5) + "\n";
}

void run_superres(const Options& options, Context& context) {
  db::Store store = context.open_store();
  store.require_writable();
  const db::Scan scan = store.scan(options.name);
  // What is wrong with the name is said before long work.
  const auto existing = store.find_scan(options.out);
  if (!existing) store.require_free_name(options.out);
  if (existing && existing->kind != db::ScanKind::kVirtual) throw made_otherwise(options.out);
  MethodChoice choice = resolve(options.method, store, scan.id, /*adapted=*/!options.adapt_minutes);
  if (options.adapt_minutes) {
    const std::filesystem::path models = adapted_models_folder(store);
    const std::filesystem::path adapted = core::path_inside(models, options.out + ".safetensors",
                                                            models.string());  // not through a link out of the store
    if (!existing) {
      adapt(store, options.name, choice, *options.adapt_minutes, adapted);
    } else if (!std::filesystem::is_regular_file(adapted)) {
      throw made_otherwise(options.out);
    }
    choice.options.model_file = adapted;
  }
  const db::LoadedScan source = load_scan(store, options.name);
  const auto interpolator = model::make_interpolator(choice.method, source.scan, choice.options);

  nlohmann::ordered_json parameters{{"source", options.name},
                                    {"method", choice.method},
                                    {"lights", options.lights},
                                    {"knobs", knob_values(choice)},
                                    {"program_version", core::kVersion}};
  if (options.adapt_minutes) parameters["adapt_minutes"] = *options.adapt_minutes;
  if (!choice.options.model_file.empty()) parameters["model_hash"] = db::hash_file(choice.options.model_file).hex();
  if (source.calibration_id) parameters["calibration"] = *source.calibration_id;
  if (source.alignment_id) parameters["alignment"] = *source.alignment_id;

  const std::vector<core::Direction> directions = virtual_directions(source.scan.directions(), options.lights);
  const SuperresReport report =
      superres(store, source, scan, *interpolator, json_text(parameters), directions, options.out);
  const bool was_there = report.already_stored == report.lights;
  std::string text = (was_there ? "'" : "made '") + options.out + "'" + (was_there ? " was there already: " : ": ") +
                     core::counted(report.lights, "light") + " by " + choice.method +
                     (was_there ? "" : ", " + fixed(report.seconds_per_image, 3) + " s an image") + "\n";
  nlohmann::ordered_json json{{"scan", options.out},
                              {"source", options.name},
                              {"method", choice.method},
                              {"lights", report.lights},
                              {"already_stored", report.already_stored},
                              {"seconds_per_image", report.seconds_per_image}};
  if (options.compress) {
    json["pack"] = pack_scan(store, options.out, options.compress_error, source.scan.exposure());
    text += text_of_pack(json["pack"]);
  }
  context.result(text, json);
}

}  // namespace

void add_superres(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("superres", "Make a scan with more lights than the stage has");
  command->footer(
      "Example:\n  lightstage superres head --lights 1024 --out head-dense\n  lightstage superres head --lights 1024 "
      "--adapt 5 --out head-adapted\n  lightstage superres head --lights 4096 --compress --out head-dense");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The captured or imported scan")->required();
  command->add_option("--out", options->out, "Name of the new scan")->required();
  command->add_option("--lights", options->lights, "Lights of the new scan")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  command
      ->add_option("--adapt", options->adapt_minutes,
                   "First train the network for so many minutes on this scan, from where it stands; the same command "
                   "goes on with what was interrupted")
      ->check(number_between(0.01, 1e5));
  CLI::Option* compress = command->add_flag(
      "--compress", options->compress, "Also pack the new scan into few basis pictures, by which `relight` is fastest");
  command
      ->add_option(
          "--compress-error", options->compress_error,
          "What that may cost: root mean square over lights and values inside the mask, relative to the pictures'")
      ->capture_default_str()
      ->check(number_between(relight::kLeastPackError, relight::kMostPackError))
      ->needs(compress);
  add_method_options(*command, options->method, kOneMethod);
  command->callback([options, &context] { run_superres(*options, context); });
}

}  // namespace lightstage::cli
