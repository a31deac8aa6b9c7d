#include "cli/calibrate_response.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "calib/response.h"
#include "cli/context.h"
#include "cli/format.h"
#include "cli/jobs/exposed_pictures.h"
#include "cli/options.h"
#include "cli/report/plot.h"
#include "cli/report/response_file.h"
#include "core/file.h"
#include "core/progress.h"

namespace lightstage::cli {

namespace {

struct Options {
  ExposureFiles files;
  calib::ResponseMethod method = calib::ResponseMethod::kDebevec;
  std::filesystem::path out;
};

std::string plot_of(const calib::CameraResponse& response) {
  PlotPanel panel{"response", {"exposure", true}, {"code", false}, {}};
  constexpr const char* kNames[] = {"red", "green", "blue"};
  for (std::size_t c = 0; c < 3; ++c) {
    PlotSeries series{kNames[c], {}, true, false, false};
    for (std::size_t k = 0; k < response.curve[c].size(); ++k) {
      series.points.push_back({response.curve[c][k], double(k), {}});
    }
    panel.series.push_back(std::move(series));
  }
  return svg_plots({panel}, 1);
}

void run_response(const Options& options, const Context& context) {
  // The codes as they are in the files.
  const ExposedPictures pictures = read_exposed_pictures(options.files, core::Encoding::kLinear);
  std::vector<calib::ExposedPicture> stack;
  for (std::size_t i = 0; i < pictures.images.size(); ++i) stack.push_back({pictures.images[i], pictures.seconds[i]});
  const calib::CameraResponse response = calib::estimate_response(stack, options.method);
  constexpr double kUsable = 0.1;  // sound sets lie at a few percent
  if (response.residual > kUsable) {
    core::warn("the pictures contradict each other by " + fixed(100 * response.residual, 0) +
               " %: are the exposure times right, and did scene, light and aperture stay the same?");
  }
  std::string text = "response of " + std::to_string(stack.size()) + " exposures; pictures agree to " +
                     fixed(100 * response.residual, 1) + " %\n";
  nlohmann::ordered_json object{{"pictures", stack.size()},
                                {"residual_percent", 100 * response.residual},
                                {"curve", {response.curve[0], response.curve[1], response.curve[2]}}};
  if (!options.out.empty()) {
    core::make_folder(options.out);
    write_response(options.out / "response.csv", response);
    core::write_file_atomically(options.out / "response.svg", plot_of(response));
    object["folder"] = options.out.string();
    text += "wrote response.csv and response.svg to " + options.out.string() + "\n";
  }
  context.result(text, object);
}

}  // namespace

void add_calibrate_response(CLI::App& calibrate, Context& context) {
  CLI::App* command = calibrate.add_subcommand(
      "response", "The response of a camera that gives 8-bit pictures, from several exposures");
  command->footer(
      "Example:\n  lightstage calibrate response a.jpg b.jpg c.jpg --exposures 1/200,1/50,0.08 --out camera\n"
      "  lightstage merge a.jpg b.jpg c.jpg --exposures 1/200,1/50,0.08 --response camera/response.csv --out hdr.exr");
  auto options = std::make_shared<Options>();
  add_exposure_options(*command, options->files);
  static const std::map<std::string, calib::ResponseMethod> kMethods{{"debevec", calib::ResponseMethod::kDebevec},
                                                                     {"robertson", calib::ResponseMethod::kRobertson}};
  command->add_option("--method", options->method, "debevec or robertson [debevec]")->transform(one_of(kMethods));
  command->add_option("--out", options->out, "Folder for response.csv and response.svg");
  command->callback([options, &context] { run_response(*options, context); });
}

}  // namespace lightstage::cli
