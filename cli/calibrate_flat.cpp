#include "cli/calibrate_flat.h"

#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/context.h"
#include "cli/format.h"
#include "cli/jobs/exposed_pictures.h"
#include "cli/jobs/flat_field.h"
#include "cli/options.h"
#include "cli/report/plot.h"
#include "core/file.h"
#include "core/progress.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::vector<std::filesystem::path> pictures;
  std::string scan, for_scan, camera;
  core::Encoding encoding = core::Encoding::kAuto;
  std::filesystem::path dark, out;
  std::optional<double> saturation;
  calib::FlatOptions fit;
};

struct Found {
  std::string camera;  // empty for loose pictures that are for no stage
  calib::FlatField field;
};

calib::FlatField from_pictures(const Options& options) {
  core::Image dark;
  if (!options.dark.empty()) dark = read_picture(options.dark, options.encoding);
  std::vector<core::Image> images;
  std::vector<calib::FlatPicture> pictures;
  for (const std::filesystem::path& file : options.pictures) {
    core::Image image = read_picture(file, options.encoding);
    if (!dark.empty() && dark.size() != image.size()) {
      throw core::BadInput(options.dark.string() + ": the dark picture is of another size than " + file.string());
    }
    for (std::size_t i = 0; i < dark.values().size(); ++i) image.values()[i] -= dark.values()[i];
    images.push_back(std::move(image));
    pictures.push_back({{}, options.saturation.value_or(usual_saturation(file)), {}});
  }
  for (std::size_t i = 0; i < images.size(); ++i) pictures[i].picture = images[i];
  return calib::fit_flat_field(pictures, options.fit);
}

std::string plot_of(const std::vector<Found>& all) {
  PlotPanel panel{"flat field", {"distance from the middle, of the corner's", false}, {"relative response", false}, {}};
  for (const Found& found : all) {
    PlotSeries series{found.camera.empty() ? "camera" : found.camera, {}, true, false, false};
    for (const std::array<double, 2>& p : found.field.profile) series.points.push_back({p[0], p[1], {}});
    panel.series.push_back(std::move(series));
  }
  return svg_plots({panel}, 1);
}

// Black is 0.5, white 1 and above: what vignetting takes shows.
core::Image shown(core::ImageView flat) {
  core::Image picture(flat);
  for (float& v : picture.values()) v = std::clamp(2 * v - 1, 0.0F, 1.0F);
  return picture;
}

void run_flat(const Options& options, const Context& context) {
  if (options.pictures.empty() == options.scan.empty()) {
    throw core::UsageError("calibrate flat: name pictures of a white card, or a pass of one with --scan");
  }
  if (!options.scan.empty() && !options.for_scan.empty()) {
    throw core::UsageError("calibrate flat: --for is for loose pictures; a pass (--scan) is of its own stage");
  }
  if (!options.scan.empty() &&
      (!options.dark.empty() || options.saturation || options.encoding != core::Encoding::kAuto)) {
    throw core::UsageError(
        "calibrate flat: --dark, --saturation and --encoding are for loose pictures; a pass (--scan) has its own");
  }
  const auto make_out = [&] {  // before anything is stored
    if (!options.out.empty()) core::make_folder(options.out);
  };
  std::vector<Found> all;
  bool stored = true;
  if (!options.scan.empty()) {
    db::Store store = context.open_store();
    store.require_writable();
    const db::Scan scan = store.scan(options.scan);
    for (const std::string& camera : scan.cameras) {
      if (!options.camera.empty() && camera != options.camera) continue;
      all.push_back({camera, flat_from_pass(store, scan, camera, options.fit)});
    }
    if (all.empty()) {
      throw core::UsageError("scan '" + scan.name + "' has no camera '" + options.camera + "'" +
                             core::did_you_mean(options.camera, scan.cameras));
    }
    make_out();
    for (const Found& found : all) store_flat_field(store, scan, found.camera, found.field, true);
  } else if (!options.for_scan.empty()) {
    db::Store store = context.open_store();
    store.require_writable();
    const db::Scan scan = store.scan(options.for_scan);
    const std::string camera = options.camera.empty() ? scan.cameras.front() : options.camera;
    if (std::find(scan.cameras.begin(), scan.cameras.end(), camera) == scan.cameras.end()) {
      throw core::UsageError("scan '" + scan.name + "' has no camera '" + camera + "'" +
                             core::did_you_mean(camera, scan.cameras));
    }
    all.push_back({camera, from_pictures(options)});
    make_out();
    store_flat_field(store, scan, camera, all.front().field, false);
  } else {
    if (options.out.empty()) {
      throw core::UsageError("calibrate flat: say where the flat field goes: --out DIR, or --for SCAN into the store");
    }
    all.push_back({options.camera, from_pictures(options)});
    make_out();
    stored = false;
  }

  std::string text;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Found& found : all) {
    const calib::FlatField& field = found.field;
    const double corner = *std::min_element(field.corner.begin(), field.corner.end());
    text += (found.camera.empty() ? "" : "camera '" + found.camera + "': ") + std::string("corners ") +
            fixed(100 * corner, 2) + " % of the middle, to " + fixed(100 * field.sigma, 3) + " %; cells lie within " +
            fixed(100 * field.residual, 3) + " % of the fit, " + fixed(100 * field.rejected, 1) + " % left out\n";
    if (field.residual > 0.02) {
      core::warn("the pictures are uneven by " + fixed(100 * field.residual, 1) +
                 " % beyond what a lens does; is it an evenly lit card, out of focus?");
    }
    nlohmann::ordered_json gradients = nlohmann::ordered_json::array();
    for (const std::array<double, 2>& g : field.gradients) gradients.push_back({100 * g[0], 100 * g[1]});
    list.push_back({{"camera", found.camera},
                    {"pictures", field.gradients.size()},
                    {"corner", field.corner},
                    {"sigma_percent", 100 * field.sigma},
                    {"residual_percent", 100 * field.residual},
                    {"condition", field.condition},
                    {"rejected", field.rejected},
                    {"gradient_percent", gradients}});
  }
  nlohmann::ordered_json object{{"flat", list}, {"stored", stored}};
  if (!options.out.empty()) {
    for (const Found& found : all) {
      const std::string name = found.camera.empty() ? "flat" : "flat_" + found.camera;
      core::write_image(options.out / (name + ".exr"), found.field.flat, {.pixel_type = core::PixelType::kFloat});
      core::write_image(options.out / (name + ".png"), shown(found.field.flat), {.encoding = core::Encoding::kLinear});
    }
    core::write_file_atomically(options.out / "flat.svg", plot_of(all));
    object["folder"] = options.out.string();
    text += "wrote the flat field and flat.svg to " + options.out.string() + "\n";
  }
  context.result(text, object);
}

}  // namespace

void add_calibrate_flat(CLI::App& calibrate, Context& context) {
  CLI::App* command = calibrate.add_subcommand("flat", "Vignetting of a camera, from pictures of a white card");
  command->footer(
      "In the store, frames of the stage's camera are divided by it from then on.\n"
      "Examples:\n"
      "  lightstage calibrate flat --scan card                  (a pass of a white card at the stage's centre)\n"
      "  lightstage calibrate flat card1.tiff card2.tiff --encoding linear --for head --camera main\n"
      "  lightstage calibrate flat card.exr --out camera");
  auto options = std::make_shared<Options>();
  command->add_option(
      "PICTURE", options->pictures,
      "Pictures of an evenly lit white card or diffuser that fills them; light or card moved in between");
  command->add_option("--scan", options->scan, "Instead: a captured pass of a white card that faces the first camera");
  command->add_option("--for", options->for_scan, "A scan on the stage whose camera took the pictures: store it there");
  command->add_option("--camera", options->camera, "Which camera [the first; with --scan all]");
  add_encoding_option(*command, options->encoding, "float files linear, others srgb");
  command->add_option("--dark", options->dark, "A picture without light, taken off");
  command
      ->add_option("--saturation", options->saturation,
                   "Value at which the camera clips, linear; 0: not known [1; of EXR and HDR files 0]")
      ->check(number_between(0.0, 1e9));
  command->add_option("--degree", options->fit.degree, "How many even powers of the radius are fitted")
      ->capture_default_str()
      ->check(CLI::Range(1, 5));
  command->add_flag("--smooth-residual", options->fit.smooth_residual,
                    "Keep what all pictures share beyond the radial fit, smoothed");
  command->add_option("--out", options->out, "Folder for the flat field as EXR and PNG, and flat.svg");
  command->callback([options, &context] { run_flat(*options, context); });
}

}  // namespace lightstage::cli
