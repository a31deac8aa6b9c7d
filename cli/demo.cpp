#include <chrono>
#include <iostream>
#include <sstream>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/evaluate/scores.h"
#include "cli/format.h"
#include "cli/program.h"
#include "cli/report/html.h"
#include "core/error.h"
#include "core/file.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;
namespace fs = std::filesystem;

struct Options {
  fs::path out = "demo";
  bool quick = false;
};

// Sizes of the full demonstration and of the reduced one.
struct Scale {
  std::string size, ball_size, train_minutes, directions, dense_lights;
};

Scale scale(bool quick) {
  return quick ? Scale{"96", "384", "0.1", "6", "60"} : Scale{"256", "512", "1.5", "24", "300"};
}

// Runs public commands one after the other, prints each as a user would type it, and keeps their results.
class Script {
 public:
  Script(fs::path store, std::ostream& shown) : store_(std::move(store)), shown_(shown) {}

  ordered_json run(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--store", store_.string()});
    std::string line = "lightstage";
    for (const std::string& argument : arguments) line += " " + argument;
    lines_ += line + "\n";
    shown_ << "\n$ " << line << std::endl;
    arguments.push_back("--json");
    std::ostringstream result;
    run_or_throw(arguments, result);
    shown_ << result.str() << std::flush;
    return ordered_json::parse(result.str());
  }

  const std::string& lines() const { return lines_; }

 private:
  fs::path store_;
  std::ostream& shown_;
  std::string lines_;
};

struct Results {
  ordered_json capture, verify, accuracy, evaluation;
  std::vector<HtmlPage::Figure> relit;
};

void relight(Script& script, Results& results, const fs::path& folder, const std::string& name,
             const std::string& caption, const std::vector<std::string>& light) {
  for (const std::string method : {"blend", "rbf", "linear"}) {
    const std::string file = name + "_" + method + ".exr";
    std::vector<std::string> arguments{"relight", "head", "--method", method, "--out", (folder / file).string()};
    arguments.insert(arguments.end(), light.begin(), light.end());
    const ordered_json relit = script.run(arguments);
    results.relit.push_back({fs::path(relit["png"].get<std::string>()).filename(), caption + ", " + method});
  }
}

Results main_job(Script& script, const fs::path& out, const Scale& scale) {
  const std::string stage = (out / "stage.toml").string();
  const std::string model = (out / "head.safetensors").string();
  Results results;
  script.run({"init"});
  script.run({"stage", "--layout", "geodesic", "--lights", "170", "--mount-error", "1", "--gain-spread", "0.05",
              "--out", stage});
  script.run({"capture", "--sim", "--mirror-ball", "--stage", stage, "--size", scale.ball_size, "--name", "ball"});
  script.run({"capture", "--sim", "--grey-ball", "--stage", stage, "--size", "128", "--name", "grey"});
  results.capture = script.run({"capture", "--sim", "--procedural", "7", "--stage", stage, "--size", scale.size,
                                "--drop", "60", "--name", "head"});
  results.verify = script.run({"store", "verify"});
  script.run({"calibrate", "ball", "--grey", "grey", "--lp", (out / "calibrated.lp").string()});
  script.run({"align", "head"});
  results.accuracy = script.run({"evaluate", "head", "--accuracy"});
  script.run({"train", "head", "--preset", "tiny", "--minutes", scale.train_minutes, "--out", model});
  results.evaluation = script.run({"evaluate", "head", "--off-grid", "--directions", scale.directions, "--method",
                                   "blend,superres,rbf,linear,nearest", "--model", model, "--sheet",
                                   (out / "contact_sheet.png").string()});
  script.run({"superres", "head", "--lights", scale.dense_lights, "--method", "blend", "--out", "head-dense"});
  relight(script, results, out, "directional", "one light between the stage's", {"--light", "35,25"});
  relight(script, results, out, "area", "an area light of 12 degrees' radius",
          {"--light", "-40,30", "--radius", "12", "--samples", "32"});
  script.run({"sky", "--sun", "50,35", "--out", (out / "sky.exr").string()});
  relight(script, results, out, "sky", "a clear sky with sun",
          {"--env", (out / "sky.exr").string(), "--quality", "good"});
  return results;
}

std::string report_page(const Results& results, const Script& script, double seconds) {
  HtmlPage page("Lightstage demonstration");
  page.paragraph(
      "A simulated light stage was captured, calibrated from a mirror ball and a grey ball, aligned, "
      "super-resolved and relit in " +
      fixed(seconds, 0) +
      " s. The errors below compare with noise-free renderings "
      "of directions where no light stands, which no real stage could give.");
  const ordered_json& methods = results.evaluation["methods"];
  page.heading("Which method won");
  page.paragraph(best_in_words(results.evaluation["best"], {}) + ".");
  std::vector<std::vector<std::string>> rows{
      {"method", "images", "RMSE", "H1", "DSSIM", "MS-SSIM", "GMSD", "FLIP", "seconds an image"}};
  for (const ordered_json& m : methods) {
    rows.push_back({m["name"].get<std::string>(), std::to_string(m["images"].get<int>()),
                    fixed(m["rmse"].get<double>(), 4), fixed(m["h1"].get<double>(), 4),
                    fixed(m["dssim"].get<double>(), 4), fixed(m["msssim"].get<double>(), 4),
                    fixed(m["gmsd"].get<double>(), 4), fixed(m["flip"].get<double>(), 4),
                    fixed(m["seconds_per_image"].get<double>(), 4)});
  }
  page.table(rows);
  page.paragraph(
      "Display-encoded values over the subject; lower is better, but for MS-SSIM. blend is the network that comes with "
      "the "
      "program; superres is a small one of the published kind, which had only the time of this demonstration to learn "
      "from it.");
  page.figures({{"contact_sheet.png", "Truth, methods, and their differences from the truth, four times enlarged"}});

  page.heading("Relit");
  page.figures(results.relit);

  page.heading("Capture, calibration, alignment");
  const ordered_json& calibration = results.accuracy["calibration"];
  const ordered_json& alignment = results.accuracy["alignment"];
  page.table({{"what", "measured"},
              {"frames of the subject pass", std::to_string(results.capture["frames"].get<int>())},
              {"dropped and retaken", std::to_string(results.capture["dropped"].get<int>()) + " and " +
                                          std::to_string(results.capture["retaken"].get<int>())},
              {"store", results.verify["ok"].get<bool>() ? "verified, all sound" : "damaged"},
              {"light directions, median error", fixed(calibration["median_deg"].get<double>(), 3) + " degrees"},
              {"light directions, 95 %", fixed(calibration["p95_deg"].get<double>(), 3) + " degrees"},
              {"light gains, median error", fixed(100 * calibration["median_gain_error"].get<double>(), 2) + " %"},
              {"motion found, median end-point error", fixed(alignment["median_epe_px"].get<double>(), 3) + " px"},
              {"PSNR of frames before and after alignment",
               fixed(alignment["psnr_unaligned_db"].get<double>(), 1) + " and " +
                   fixed(alignment["psnr_aligned_db"].get<double>(), 1) + " dB"}});
  page.heading("The commands");
  page.code(script.lines());
  return page.finish();
}

void run_demo(const Options& options, Context& context) {
  const auto begin = std::chrono::steady_clock::now();
  core::make_folder(options.out);
  if (fs::exists(options.out / "store")) {
    throw core::UsageError(options.out.string() + " holds a demonstration already; remove it or choose another --out");
  }
  // With --json, stdout is for the one object alone.
  std::ostream& shown = context.json ? std::cerr : context.out();
  Script script(options.out / "store", shown);
  const Results results = main_job(script, options.out, scale(options.quick));

  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const fs::path report = options.out / "report.html";
  core::write_file_atomically(report, report_page(results, script, seconds));
  ordered_json object{{"calibration", results.accuracy["calibration"]},
                      {"alignment", results.accuracy["alignment"]},
                      {"evaluation", {{"methods", results.evaluation["methods"]}}},
                      {"wall_s", seconds},
                      {"report", report.string()}};
  std::vector<std::vector<std::string>> rows{{"method", "RMSE", "H1", "DSSIM", "FLIP"}};
  for (const ordered_json& m : results.evaluation["methods"]) {
    rows.push_back({m["name"].get<std::string>(), fixed(m["rmse"].get<double>(), 4), fixed(m["h1"].get<double>(), 4),
                    fixed(m["dssim"].get<double>(), 4), fixed(m["flip"].get<double>(), 4)});
  }
  context.result("\n" + table(rows) + best_in_words(results.evaluation["best"], {}) + "\nDone in " + fixed(seconds, 0) +
                     " s. Open " + report.string() + "\n",
                 object);
}

}  // namespace

void add_demo(CLI::App& program, Context& context) {
  CLI::App* command =
      program.add_subcommand("demo", "The whole job on a simulated stage, as a script of the other commands");
  command->footer("Example:\n  lightstage demo --out demo");
  auto options = std::make_shared<Options>();
  command->add_option("--out", options->out, "Folder for store, pictures and report")->capture_default_str();
  command->add_flag("--quick", options->quick, "Small pictures and little training: a minute instead of several");
  command->callback([options, &context] { run_demo(*options, context); });
}

}  // namespace lightstage::cli
