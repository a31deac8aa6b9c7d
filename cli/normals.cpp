#include <chrono>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "model/normals.h"
#include "relight/picture.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string name;
  std::filesystem::path out;
};

void make_folder(const std::filesystem::path& folder) {
  try {
    core::make_folder(folder);
  } catch (const core::BadInput&) {
    throw core::UsageError("--out: '" + folder.string() + "' is no folder and cannot be made one");
  }
}

// Black where the mask says that there is no subject.
core::Image cut_out(core::Image map, core::ImageView mask) {
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x)
      if (mask(y, x) <= 0.5F) std::fill_n(map.pixel(y, x), map.channels(), 0.0F);
  return map;
}

// As normal maps are shown and kept in 8 bits: (n + 1) / 2, black where there is none.
core::Image shown_normals(core::ImageView normals, core::ImageView mask) {
  core::Image shown(normals);
  for (float& value : shown.values()) value = (value + 1) / 2;
  return cut_out(std::move(shown), mask);
}

double masked_median(core::ImageView map, core::ImageView mask) {
  std::vector<float> values;
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x)
      if (mask(y, x) > 0.5F) values.push_back(map(y, x));
  return core::quantile(values, 0.5);
}

void run_normals(const Options& options, Context& context) {
  db::Store store = context.open_store();
  store.require_writable();
  const db::Scan scan = store.scan(options.name);
  const db::LoadedScan source = load_scan(store, options.name);
  make_folder(options.out);

  const auto start = std::chrono::steady_clock::now();
  const model::SurfaceMaps maps = model::estimate_normals(source.scan);
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;

  const core::Image& mask = source.scan.mask();
  core::write_image(options.out / "normals.exr", cut_out(maps.normals, mask), {.pixel_type = core::PixelType::kFloat});
  core::write_image(options.out / "normals.png", shown_normals(maps.normals, mask),
                    {.encoding = core::Encoding::kLinear});
  const core::Image albedo = cut_out(maps.albedo, mask);
  relight::write_picture(options.out / "albedo.exr", albedo, relight::auto_exposure_stops(albedo, mask));
  const core::Image confidence = cut_out(maps.confidence, mask);
  core::write_image(options.out / "confidence.exr", confidence);
  core::write_image(options.out / "confidence.png", confidence, {.encoding = core::Encoding::kLinear});

  db::NewProduct product;
  product.kind = "normals";
  product.scan_id = scan.id;
  product.input_scans = {scan.id};
  product.input_products = source.products();
  product.parameters = json_text({{"folder", std::filesystem::absolute(options.out).string()}});
  store.add_product(product);

  const double confident = masked_median(maps.confidence, mask);
  context.result("normals, albedo and confidence of '" + options.name + "' in " + fixed(elapsed.count(), 2) +
                     " s, median confidence " + fixed(confident, 2) + "\nwrote " + options.out.string() + "\n",
                 {{"scan", options.name},
                  {"folder", options.out.string()},
                  {"lights", source.scan.light_count()},
                  {"median_confidence", confident},
                  {"seconds", elapsed.count()}});
}

}  // namespace

void add_normals(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("normals", "Normal and albedo maps of the subject, by photometric stereo");
  command->footer(
      "normals.exr holds x, y, z of unit normals in the stage frame (x right, y up, z towards the primary camera), "
      "normals.png (n + 1) / 2;\nalbedo.exr is 1 for a white matte surface; confidence.exr in [0, 1] is the share of "
      "the lights before the surface that agree\nwith its maps, over the condition number of their directions. A PNG "
      "to look at comes beside each.\n"
      "Example:\n  lightstage normals head --out head-maps");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  command->add_option("--out", options->out, "Folder for the maps; made where there is none")->required();
  command->callback([options, &context] { run_normals(*options, context); });
}

}  // namespace lightstage::cli
