#include "cli/calibrate_colour.h"

#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "calib/colour_chart.h"
#include "cli/context.h"
#include "cli/format.h"
#include "cli/jobs/exposed_pictures.h"
#include "cli/options.h"
#include "cli/report/colour_file.h"
#include "core/file.h"
#include "core/progress.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::filesystem::path picture, dark, out;
  core::Encoding encoding = core::Encoding::kAuto;
  std::optional<double> saturation;
  std::vector<double> corners;
  std::string for_scan, camera;
};

constexpr int kColumns = 6, kSwatch = 72;

void fill(core::Image& image, int top, int left, int side, const std::array<double, 3>& colour) {
  for (int y = top; y < top + side; ++y) {
    for (int x = left; x < left + side; ++x) {
      for (int c = 0; c < 3; ++c) image(y, x, c) = float(std::clamp(colour[std::size_t(c)], 0.0, 1.0));
    }
  }
}

// The chart as it should be, and on every patch, in the middle, what the picture gives after the fit.
core::Image swatches(const calib::ChartReading& reading, const calib::ColourFit& fit) {
  const int rows = int(reading.patches.size()) / kColumns;
  core::Image image(rows * kSwatch, kColumns * kSwatch, 3);
  for (std::size_t i = 0; i < reading.patches.size(); ++i) {
    const calib::ChartPatch& patch = reading.patches[i];
    std::array<double, 3> found{};
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = 0; c < 3; ++c) {
        found[r] += fit.exposure * fit.matrix[r][c] * fit.white_balance[c] * patch.value[c];
      }
    }
    const int top = int(i) / kColumns * kSwatch, left = int(i) % kColumns * kSwatch;
    fill(image, top + 2, left + 2, kSwatch - 4, patch.reference);
    fill(image, top + kSwatch / 4, left + kSwatch / 4, kSwatch / 2, found);
  }
  return image;
}

// The picture with the patches' places marked.
core::Image marked(core::Image picture, const calib::ChartReading& reading, double exposure) {
  for (float& v : picture.values()) v = std::clamp(float(double(v) * exposure), 0.0F, 1.0F);
  const auto dot = [&](double px, double py, const std::array<double, 3>& colour) {
    constexpr int kSide = 3;
    const int x = int(std::lround(px)) - 1, y = int(std::lround(py)) - 1;
    if (x < 0 || y < 0 || x + kSide > picture.width() || y + kSide > picture.height()) return;
    fill(picture, y, x, kSide, colour);
  };
  for (const calib::ChartPatch& patch : reading.patches) {
    dot(patch.centre.x, patch.centre.y, patch.used ? std::array{0.0, 1.0, 0.0} : std::array{1.0, 0.0, 0.0});
  }
  constexpr int kSteps = 300;
  for (std::size_t i = 0; i < 4; ++i) {
    const core::Pixel a = reading.corners[i], b = reading.corners[(i + 1) % 4];
    for (int k = 0; k < kSteps; ++k) {
      const double t = double(k) / kSteps;
      dot(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), {0.0, 1.0, 0.0});
    }
  }
  return picture;
}

void run_colour(const Options& options, const Context& context) {
  if (options.out.empty() && options.for_scan.empty()) {
    throw core::UsageError("calibrate colour: say where the colours go: --out DIR, or --for SCAN into the store");
  }
  if (options.for_scan.empty() && !options.camera.empty()) {
    throw core::UsageError("calibrate colour: --camera is for --for SCAN; a file of colours has none");
  }
  core::Image picture = read_picture(options.picture, options.encoding);
  if (!options.dark.empty()) {
    const core::Image dark = read_picture(options.dark, options.encoding);
    if (dark.size() != picture.size()) {
      throw core::BadInput(options.dark.string() + ": the dark picture is of another size than the chart's");
    }
    for (std::size_t i = 0; i < dark.values().size(); ++i) picture.values()[i] -= dark.values()[i];
  }
  std::optional<std::array<core::Pixel, 4>> corners;
  if (!options.corners.empty()) {
    corners.emplace();
    for (std::size_t i = 0; i < 4; ++i) (*corners)[i] = {options.corners[2 * i], options.corners[2 * i + 1]};
  }
  calib::ChartReading reading;
  calib::ColourFit fit;
  try {
    reading = calib::read_chart(picture, options.saturation.value_or(usual_saturation(options.picture)), corners);
    fit = calib::fit_colour(reading);
  } catch (const core::BadInput& error) {
    throw core::BadInput(options.picture.string() + ": " + error.what());
  }

  std::vector<std::vector<std::string>> rows{{"patch", "CIEDE2000", "balanced alone", "remark"}};
  nlohmann::ordered_json patches = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < reading.patches.size(); ++i) {
    const calib::ChartPatch& patch = reading.patches[i];
    rows.push_back({patch.name, fixed(fit.delta_e[i], 2), fixed(fit.delta_e_balanced[i], 2),
                    patch.used ? "" : "left out: " + patch.reason});
    patches.push_back({{"name", patch.name},
                       {"x", patch.centre.x},
                       {"y", patch.centre.y},
                       {"camera", patch.value},
                       {"sigma", patch.sigma},
                       {"reference", patch.reference},
                       {"delta_e", fit.delta_e[i]},
                       {"delta_e_balanced", fit.delta_e_balanced[i]},
                       {"used", patch.used},
                       {"reason", patch.reason}});
    if (!patch.used) core::warn("patch '" + patch.name + "' is left out: " + patch.reason);
  }
  std::string text = table(rows) + "mean CIEDE2000 " + fixed(fit.mean_delta_e, 2) + " over " +
                     std::to_string(fit.used) +
                     " patches (white balance alone: " + fixed(fit.mean_delta_e_balanced, 2) + "), largest " +
                     fixed(fit.largest_delta_e, 2) + "\n";
  nlohmann::ordered_json object{{"white_balance", fit.white_balance},
                                {"matrix", fit.matrix},
                                {"exposure", fit.exposure},
                                {"mean_delta_e", fit.mean_delta_e},
                                {"largest_delta_e", fit.largest_delta_e},
                                {"mean_delta_e_balanced", fit.mean_delta_e_balanced},
                                {"used", fit.used},
                                {"patches", patches},
                                {"stored", !options.for_scan.empty()}};
  if (!options.for_scan.empty()) {
    db::Store store = context.open_store();
    const db::Scan scan = store.scan(options.for_scan);
    if (!options.camera.empty() &&
        std::find(scan.cameras.begin(), scan.cameras.end(), options.camera) == scan.cameras.end()) {
      throw core::UsageError("scan '" + scan.name + "' has no camera '" + options.camera + "'" +
                             core::did_you_mean(options.camera, scan.cameras));
    }
    if (!options.out.empty()) core::make_folder(options.out);  // before anything is stored
    // Gains of a grey ball balance the white already.
    nlohmann::ordered_json parameters{
        {"matrix", whole_matrix(fit, true)}, {"mean_delta_e", fit.mean_delta_e}, {"picture", options.picture.string()}};
    if (!options.camera.empty()) parameters["camera"] = options.camera;
    db::NewProduct product;
    product.kind = "colour";
    product.stage_key = scan.stage_key;
    product.parameters = json_text(parameters);
    store.add_product(product);
    text += "stored: pictures of the stage of '" + scan.name + "' get these colours when they are loaded\n";
  }
  if (!options.out.empty()) {
    core::make_folder(options.out);
    write_colour(options.out / "colour.toml", fit, options.picture.filename().string());
    core::write_image(options.out / "swatches.png", swatches(reading, fit));
    core::write_image(options.out / "chart.png", marked(std::move(picture), reading, fit.exposure));
    object["folder"] = options.out.string();
    text += "wrote colour.toml, swatches.png and chart.png to " + options.out.string() + "\n";
  }
  context.result(text, object);
}

}  // namespace

void add_calibrate_colour(CLI::App& calibrate, Context& context) {
  CLI::App* command =
      calibrate.add_subcommand("colour", "A camera's colours, from a picture of a colour chart of 24 patches");
  command->footer(
      "Examples:\n"
      "  lightstage calibrate colour chart.tiff --encoding linear --out camera\n"
      "  lightstage import csv photos/lights.csv --colour camera/colour.toml --name mine\n"
      "  lightstage calibrate colour chart.exr --for head       (the stage's own camera, under the stage's lights)");
  auto options = std::make_shared<Options>();
  command->add_option("PICTURE", options->picture, "Picture of the chart, evenly lit, nothing clipped")->required();
  add_encoding_option(*command, options->encoding, "float files linear, others srgb");
  command->add_option("--dark", options->dark, "A picture without light, taken off");
  command
      ->add_option("--saturation", options->saturation,
                   "Value at which the camera clips, linear; 0: not known [1; of EXR and HDR files 0]")
      ->check(number_between(0.0, 1e9));
  command
      ->add_option(
          "--corners", options->corners,
          "Where the chart is, if it is not found: x,y of the outer corners at dark skin, bluish green, black, "
          "white, pixels")
      ->delimiter(',')
      ->expected(8);
  command->add_option("--for", options->for_scan, "A scan on the stage whose camera took the picture: store it there");
  command->add_option("--camera", options->camera, "Which camera of that stage [all]");
  command->add_option("--out", options->out, "Folder for colour.toml, swatches.png and chart.png");
  command->callback([options, &context] { run_colour(*options, context); });
}

}  // namespace lightstage::cli
