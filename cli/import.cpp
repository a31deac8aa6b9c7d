#include <algorithm>
#include <map>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/options.h"
#include "cli/report/colour_file.h"
#include "core/text.h"
#include "db/importers.h"

namespace lightstage::cli {

namespace {

using Reader = db::PictureSet (*)(const std::filesystem::path&);

struct Format {
  const char* name;
  const char* example;
  const char* help;
  const char* path_help;
  Reader read;
};

constexpr Format kFormats[] = {
    {"lp", "lightstage import lp dome/dirs.lp --name lion", "RTI: an .lp file of pictures and light directions",
     "The .lp file", db::read_lp_set},
    {"diligent", "lightstage import diligent bearPNG --name bear",
     "A folder with filenames.txt, light_directions.txt, light_intensities.txt, mask.png", "The folder",
     db::read_diligent_set},
    {"yale", "lightstage import yale yaleB02 --name face", "A folder of the Extended Yale Face Database B",
     "The folder", db::read_yale_set},
    {"csv",
     "lightstage import csv photos/lights.csv --name mine        (lights.csv: file,x,y,z then p1.png,0,0.5,1 and so "
     "on)",
     "A CSV file with columns file and x,y,z or longitude,latitude; optional r,g,b or intensity",
     "The CSV file, or a folder with one lights.csv", db::read_csv_set},
};

struct Options {
  std::filesystem::path path;
  std::string name;
  std::optional<core::Encoding> encoding;
  std::filesystem::path colour;
};

void run_import(const Format& format, const Options& options, Context& context) {
  db::PictureSet set = format.read(options.path);
  if (!options.colour.empty()) {
    // Lights whose colours the set tells are divided out: what they lit is balanced already.
    const bool balanced = std::any_of(set.pictures.begin(), set.pictures.end(), [](const db::PictureEntry& picture) {
      return picture.intensity[0] != picture.intensity[1] || picture.intensity[1] != picture.intensity[2];
    });
    set.colour = whole_matrix(read_colour(options.colour), balanced);
  }
  db::Store store = context.open_store();
  const db::ImportReport report = db::import_pictures(store, set, options.name, options.encoding);
  std::string text = "imported " + core::counted(report.pictures, "picture") + " of " +
                     std::to_string(report.size.width) + " x " + std::to_string(report.size.height) + " pixels as '" +
                     options.name + "'\n";
  nlohmann::ordered_json excluded = nlohmann::ordered_json::array();
  for (const db::CalibratedLight& light : report.excluded) {
    const std::string file = set.pictures.at(std::size_t(light.light_index)).path.filename().string();
    text += "  left out: " + light.reason + "\n";
    excluded.push_back({{"light", light.light_index}, {"file", file}, {"reason", light.reason}});
  }
  context.result(text, {{"scan", options.name},
                        {"pictures", report.pictures},
                        {"width", report.size.width},
                        {"height", report.size.height},
                        {"channels", report.size.channels},
                        {"excluded", excluded}});
}

}  // namespace

void add_import(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("import", "Make a scan of your own photographs");
  command->footer(
      "Examples:\n"
      "  lightstage import lp dome/dirs.lp --name lion\n"
      "  lightstage import diligent bearPNG --name bear");
  command->require_subcommand(1);
  const std::map<std::string, core::Encoding> encodings{{"linear", core::Encoding::kLinear},
                                                        {"srgb", core::Encoding::kSrgb}};
  for (const Format& format : kFormats) {
    CLI::App* reader = command->add_subcommand(format.name, format.help);
    reader->fallthrough();
    reader->footer(std::string("Example:\n  ") + format.example);
    auto options = std::make_shared<Options>();
    reader->add_option("PATH", options->path, format.path_help)->required();
    reader->add_option("--name", options->name, "Name of the new scan")->required();
    reader
        ->add_option("--encoding", options->encoding,
                     "linear or srgb: what the files' numbers are [what is usual for the format]")
        ->transform(one_of(encodings));
    reader->add_option("--colour", options->colour,
                       "colour.toml of `calibrate colour`: camera colours to linear Rec. 709, on loading");
    reader->callback([&format, options, &context] { run_import(format, *options, context); });
  }
}

}  // namespace lightstage::cli
