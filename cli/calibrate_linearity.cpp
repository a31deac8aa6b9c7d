#include "cli/calibrate_linearity.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "calib/linearity.h"
#include "cli/context.h"
#include "cli/format.h"
#include "cli/jobs/exposed_pictures.h"
#include "cli/options.h"
#include "cli/report/plot.h"
#include "core/file.h"

namespace lightstage::cli {

namespace {

struct Options {
  ExposureFiles files;
  core::Encoding encoding = core::Encoding::kLinear;
  std::filesystem::path out;
};

std::string plot_of(const calib::LinearityReport& report) {
  const auto series = [](const std::string& name, const std::vector<calib::LinearityPoint>& points, bool line) {
    PlotSeries s{name, {}, line, true, false};
    for (const calib::LinearityPoint& p : points) s.points.push_back({100 * p.signal, 100 * p.deviation, {}});
    return s;
  };
  return svg_plots(
      {{"deviation from proportionality",
        {"signal, % of the range", false},
        {"deviation, %", false},
        {series("all cells, by signal", report.points, true), series("pictures", report.exposures, false)}}},
      1);
}

nlohmann::ordered_json points_of(const std::vector<calib::LinearityPoint>& points) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const calib::LinearityPoint& p : points) {
    list.push_back({{"signal", p.signal}, {"deviation_percent", 100 * p.deviation}});
  }
  return list;
}

void run_linearity(const Options& options, const Context& context) {
  const ExposedPictures pictures = read_exposed_pictures(options.files, options.encoding);
  std::vector<calib::ExposedPicture> stack;
  for (std::size_t i = 0; i < pictures.images.size(); ++i) stack.push_back({pictures.images[i], pictures.seconds[i]});
  const calib::LinearityReport report = calib::check_linearity(stack);
  std::string text = report.verdict + "\nblack level " + fixed(report.black_level, 5) + "; " +
                     (report.clips_at ? "clips at " + fixed(*report.clips_at, 4) : "does not clip in these pictures") +
                     "\n";
  if (report.electrons_per_unit) {
    text +=
        fixed(*report.electrons_per_unit, 0) + " electrons at 1" +
        (report.full_well_electrons ? ", " + fixed(*report.full_well_electrons, 0) + " where it clips" : "") +
        (report.read_noise_electrons ? "; read noise " + fixed(*report.read_noise_electrons, 2) + " electrons" : "") +
        "\n";
  }
  nlohmann::ordered_json object{{"linear", report.linear},
                                {"verdict", report.verdict},
                                {"largest_deviation_percent", 100 * report.largest_deviation},
                                {"at_signal", report.largest_at},
                                {"black_level", report.black_level},
                                {"clips_at", or_null(report.clips_at)},
                                {"electrons_per_unit", or_null(report.electrons_per_unit)},
                                {"full_well_electrons", or_null(report.full_well_electrons)},
                                {"read_noise_electrons", or_null(report.read_noise_electrons)},
                                {"points", points_of(report.points)},
                                {"pictures", points_of(report.exposures)}};
  if (!options.out.empty()) {
    core::make_folder(options.out);
    core::write_file_atomically(options.out / "linearity.svg", plot_of(report));
    object["folder"] = options.out.string();
    text += "wrote linearity.svg to " + options.out.string() + "\n";
  }
  context.result(text, object);
}

}  // namespace

void add_calibrate_linearity(CLI::App& calibrate, Context& context) {
  CLI::App* command = calibrate.add_subcommand(
      "linearity", "Whether a camera's values are proportional to light; its black level, clipping and noise");
  command->footer(
      "Two pictures of each exposure tell the noise as well.\n"
      "Example:\n  lightstage calibrate linearity raw*.tiff --exposures 0.002,0.002,0.01,0.01,0.04,0.04 --out camera");
  auto options = std::make_shared<Options>();
  add_exposure_options(*command, options->files);
  add_encoding_option(*command, options->encoding, "linear");
  command->add_option("--out", options->out, "Folder for linearity.svg");
  command->callback([options, &context] { run_linearity(*options, context); });
}

}  // namespace lightstage::cli
