// The protocols of `evaluate` and the files they write, on small scans.
#include <catch2/catch.hpp>
#include <fstream>
#include <set>
#include <sstream>

#include "cli/darkroom.h"
#include "cli/program.h"
#include "core/image_file.h"
#include "support/support.h"

using namespace lightstage;
using nlohmann::json;
using test::Darkroom;
namespace fs = std::filesystem;

namespace {

// A box under 60 lights, simulated without noise or motion: its truth between the lights is known.
class BoxScan {
 public:
  BoxScan() {
    const std::string mesh = (folder_ / "box.obj").string(), stage = (folder_ / "stage.toml").string();
    std::ofstream(mesh) << "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n"
                           "f 5 6 7\nf 5 7 8\nf 2 1 4\nf 2 4 3\nf 6 2 3\nf 6 3 7\nf 1 5 8\nf 1 8 4\nf 8 7 3\nf 8 3 "
                           "4\nf 1 2 6\nf 1 6 5\n";
    succeed({"init"});
    succeed({"stage", "--layout", "fibonacci", "--lights", "60", "--out", stage});
    succeed({"capture", "--sim", "--mesh", mesh, "--stage", stage, "--size", "48", "--no-noise", "--no-motion", "--yaw",
             "30", "--name", "box"});
  }

  json succeed(std::vector<std::string> arguments) const {
    arguments.insert(arguments.end(), {"--json", "--quiet"});
    const test::Outcome outcome = test::run_program(folder_ / "store", arguments);
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.json();
  }

  fs::path operator/(const std::string& name) const { return folder_ / name; }

 private:
  test::TemporaryFolder folder_;
};

std::string text_of(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t n = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + what.size())) ++n;
  return n;
}

std::set<std::string> names(const json& methods) {
  std::set<std::string> result;
  for (const json& method : methods) result.insert(method["name"].get<std::string>());
  return result;
}

void check_refused(const test::Outcome& outcome, int status, const std::vector<std::string>& said) {
  INFO(outcome.err);
  CHECK(outcome.status == status);
  CHECK(outcome.out.empty());
  for (const std::string& text : said) CHECK(outcome.err.find(text) != std::string::npos);
}

}  // namespace

TEST_CASE(
    "every method is judged by every measure, by angle and with its memory, and the protocol says whom it favours") {
  const Darkroom darkroom;
  const test::Outcome outcome =
      darkroom.run({"evaluate", "ball", "--held-out", "--every", "5", "--method", "all", "--json", "--quiet"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const json result = outcome.json();
  CHECK(result["notes"][0].get<std::string>().find("naive") != std::string::npos);
  for (const std::string name : {"nearest", "linear", "rbf", "blend"}) CHECK(names(result["methods"]).count(name) == 1);
  CHECK(names(result["methods"]).count("superres") == 0);  // never trained
  double lowest = 1, highest = 0;
  for (const json& method : result["methods"]) {
    lowest = std::min(lowest, method["gmsd"].get<double>());
    highest = std::max(highest, method["msssim"].get<double>());
  }
  for (const json& method : result["methods"]) {
    if (method["name"] == result["best"]["gmsd"]) CHECK(method["gmsd"] == lowest);
    if (method["name"] == result["best"]["msssim"]) CHECK(method["msssim"] == highest);
  }
  for (const json& method : result["methods"]) {
    INFO(method.dump());
    CHECK(method["images"] == 5);
    CHECK(method["msssim"].get<double>() > 0);
    CHECK(method["msssim"].get<double>() < 1);
    CHECK(method["gmsd"].get<double>() > 0);
    CHECK(method["flip"].get<double>() > 0);
    CHECK_FALSE(method.contains("hdr_flip"));
    CHECK((method["peak_rss_bytes"].is_null() || method["peak_rss_bytes"].get<double>() > 1e6));
    REQUIRE(method["by_angle"].size() == 11);
    int images = 0;
    double squares = 0;
    for (const json& bin : method["by_angle"]) {
      const int in_bin = bin["images"].get<int>();
      images += in_bin;
      CHECK(bin["rmse"].is_null() == (in_bin == 0));
      if (in_bin > 0) squares += in_bin * std::pow(bin["rmse"].get<double>(), 2);
    }
    CHECK(images == 5);
    CHECK(std::sqrt(squares / 5) == Approx(method["rmse"].get<double>()));
    CHECK(method["by_angle"][0]["images"] == 0);  // lights left out stand 30 degrees from others
    CHECK(method["by_angle"][10]["images"] == 5);
  }
}

TEST_CASE("without --json the best method by each measure is named") {
  const Darkroom darkroom;
  const test::Outcome outcome =
      darkroom.run({"evaluate", "ball", "--held-out", "--every", "8", "--method", "nearest,rbf", "--quiet"});
  INFO(outcome.out);
  CHECK(outcome.out.find("lowest RMSE, H1, DSSIM, GMSD, FLIP: rbf; highest MS-SSIM: rbf") != std::string::npos);
  CHECK(outcome.out.find("peak MiB") != std::string::npos);
}

TEST_CASE("a report holds tables, plots, crops and a page that shows them") {
  const Darkroom darkroom;
  const fs::path report = fs::path(darkroom / "deep") / "report";
  const test::Outcome outcome =
      darkroom.run({"evaluate", "ball", "--held-out", "--every", "5", "--method", "nearest,linear,rbf", "--hdr-flip",
                    "--report", report.string(), "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const json printed = outcome.json(), written = json::parse(text_of(report / "report.json"));
  CHECK(written["methods"] == printed["methods"]);
  CHECK(written["methods"][0]["hdr_flip"].get<double>() > 0);
  CHECK(printed["report"] == (report / "index.html").string());
  const std::string csv = text_of(report / "report.csv");
  CHECK(csv.find("lights,method,images,rmse,h1,dssim,msssim,gmsd,flip,hdr_flip,seconds_per_image,peak_rss_bytes\n") ==
        0);
  CHECK(count(csv, "\n") == 4);
  CHECK(count(text_of(report / "by_angle.csv"), "\n") == 1 + 3 * 11);
  const std::string markdown = text_of(report / "report.md");
  CHECK(markdown.find("| method | images | RMSE |") != std::string::npos);
  CHECK(markdown.find("naive") != std::string::npos);
  const std::string page = text_of(report / "index.html");
  CHECK(page.find("naive") != std::string::npos);
  for (const std::string file : {"error_by_angle.svg", "error_by_time.svg", "crops_1.png", "crops_4.png"}) {
    INFO(file);
    CHECK(fs::exists(report / file));
    CHECK(page.find("src=\"" + file + "\"") != std::string::npos);
  }
  CHECK_FALSE(fs::exists(report / "crops_5.png"));
  const std::string svg = text_of(report / "error_by_time.svg");
  CHECK(svg.find("<svg ") == 0);
  CHECK(svg.rfind("</svg>\n") == svg.size() - 7);
  for (const std::string name : {"nearest", "linear", "rbf"}) CHECK(count(svg, ">" + name + "</text>") == 1);
  CHECK(svg.find("nan") == std::string::npos);
}

TEST_CASE("fewer lights cost accuracy off the grid, with as many neighbours as published") {
  const BoxScan box;
  const json result = box.succeed({"evaluate", "box", "--subsample", "20,60", "--directions", "8", "--method",
                                   "linear,rbf", "--report", (box / "report").string()});
  CHECK(result["protocol"] == "subsample");
  REQUIRE(result["stages"].size() == 2);
  CHECK(result["stages"][0]["lights"] == 60);
  CHECK(result["stages"][1]["lights"] == 20);
  CHECK(result["stages"][0]["neighbours"] == 4);
  for (const std::size_t method : {0, 1}) {
    const json &many = result["stages"][0]["methods"][method], &few = result["stages"][1]["methods"][method];
    CHECK(many["images"] == 8);
    CHECK(few["rmse"].get<double>() > 1.1 * many["rmse"].get<double>());
  }
  CHECK(count(text_of(box / "report" / "report.csv"), "\n") == 5);
  CHECK(text_of(box / "report" / "report.csv").find("\n20,rbf,8,") != std::string::npos);
  CHECK(text_of(box / "report" / "index.html").find("error_by_lights.svg") != std::string::npos);
}

TEST_CASE("the frontier holds every method's settings, and no point on it is beaten") {
  const BoxScan box;
  // What is wrong with a command is said before the truth is rendered, which takes long.
  for (const std::string& protocol :
       std::vector<std::string>{"--off-grid", "--subsample=30", "--frontier=" + (box / "x").string()}) {
    const test::Outcome refused = test::run_program(
        box / "store", {"evaluate", "box", protocol, "--metric-model", (box / "stage.toml").string()});
    check_refused(refused, 3, {"TorchScript"});
    CHECK(refused.err.find("rendering the truth") == std::string::npos);
  }
  const json printed = box.succeed(
      {"evaluate", "box", "--frontier", (box / "out").string(), "--directions", "6", "--method", "nearest,linear,rbf"});
  const json written = json::parse(text_of(box / "out" / "frontier.json"));
  CHECK(written == printed);
  CHECK(written["protocol"] == "off-grid");  // the scan is simulated
  const json& points = written["points"];
  std::size_t defaults = 0, of_linear = 0;
  std::set<std::string> of_rbf;
  for (const json& point : points) {
    if (point["method"] == "rbf") of_rbf.insert(point["setting"].get<std::string>());
    defaults += point["setting"] == "default" ? 1 : 0;
    of_linear += point["method"] == "linear" ? 1 : 0;
  }
  CHECK(defaults == 3);
  CHECK(of_linear > 5);
  CHECK(of_rbf ==
        std::set<std::string>{"default", "--kernel linear", "--smoothing 1e-4", "--smoothing 1e-3", "--domain linear"});
  const auto on = [](const json& point, const std::string& front, const std::string& measure) {
    return std::find(point[front].begin(), point[front].end(), measure) != point[front].end();
  };
  for (const std::string measure : {"rmse", "dssim", "flip", "gmsd"}) {
    const std::string cost = "seconds_per_image";
    std::size_t on_front = 0;
    for (const json& point : points) {
      bool beaten = false;
      for (const json& other : points) {
        beaten = beaten || (other[cost] <= point[cost] && other[measure] <= point[measure] &&
                            (other[cost] < point[cost] || other[measure] < point[measure]));
      }
      CHECK(on(point, "time_fronts", measure) == !beaten);
      on_front += beaten ? 0 : 1;
    }
    CHECK(on_front >= 1);
    CHECK(on_front < points.size());
  }
  CHECK(count(text_of(box / "out" / "frontier.csv"), "\n") == points.size() + 1);
  const std::string svg = text_of(box / "out" / "frontier.svg");
  CHECK(count(svg, "Pareto front") == 1);
  CHECK(count(svg, "<title>linear, --neighbours 4</title>") >= 3);  // a panel each
  CHECK(svg.find("stroke-dasharray") != std::string::npos);
}

TEST_CASE("along an arc the nearest light jumps, blending does not, and strips show it") {
  const BoxScan box;
  const json result =
      box.succeed({"evaluate", "box", "--arc", (box / "arc").string(), "--steps", "24", "--method", "nearest,linear"});
  CHECK(result["steps"] == 24);
  CHECK(result["degrees"].get<double>() > 30);  // twice the distance of two of 60 lights
  const json &nearest = result["methods"][0], &linear = result["methods"][1], &truth = result["truth"];
  CHECK(nearest["second_difference_largest"].get<double>() > 3 * linear["second_difference_largest"].get<double>());
  CHECK(nearest["second_difference_largest"].get<double>() > 3 * truth["second_difference_largest"].get<double>());
  CHECK(nearest["second_difference_mean"].get<double>() < nearest["second_difference_largest"].get<double>());
  CHECK(nearest["rmse"].get<double>() > 0);
  if (!truth["edge"].is_null()) CHECK(truth["edge"]["off_truth_px"] == 0);
  for (const std::string name : {"truth", "nearest", "linear"}) {
    const core::ImageSize size = core::read_image_size(box / "arc" / ("strip_" + name + ".png"));
    CHECK(size.height == 4 * 25);
    CHECK(size.width > 48);
  }
  CHECK(json::parse(text_of(box / "arc" / "arc.json")) == result);
  CHECK(text_of(box / "arc" / "index.html").find("strip_nearest.png") != std::string::npos);
  // Real photographs have no truth, but second differences all the same; ends may be chosen.
  const Darkroom darkroom;
  const test::Outcome real = darkroom.run({"evaluate", "ball", "--arc", darkroom / "arc", "--from", "0,10", "--to",
                                           "40,10", "--steps", "5", "--method", "linear", "--json"});
  REQUIRE(real.status == 0);
  CHECK(real.json()["degrees"].get<double>() == Approx(39.3).margin(0.2));
  CHECK(real.json()["truth"].is_null());
  CHECK(real.json()["methods"][0]["edge"].is_null());
  CHECK(real.json()["methods"][0]["second_difference_mean"].get<double>() > 0);
}

TEST_CASE("options that a protocol would not heed, and what it cannot do, are refused") {
  const Darkroom darkroom;
  const auto refused = [&](std::vector<std::string> more, int status, const std::vector<std::string>& said) {
    std::vector<std::string> arguments{"evaluate", "ball"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    check_refused(darkroom.run(arguments), status, said);
  };
  refused({}, 2, {"--held-out", "--frontier", "--arc"});
  refused({"--held-out", "--off-grid"}, 2, {"give one"});
  refused({"--held-out", "--arc", "x"}, 2, {"give one"});
  refused({"--subsample", "0"}, 2, {"--subsample"});
  refused({"--subsample", "25"}, 2, {"24 lights", "25"});
  refused({"--subsample", "12"}, 2, {"not captured"});
  refused({"--subsample", "12", "--neighbours", "3"}, 2, {"--neighbours"});
  refused({"--frontier", darkroom / "x", "--report", darkroom / "y"}, 2, {"--report"});
  refused({"--held-out", "--sheet", "x.png"}, 2, {"--sheet"});
  refused({"--held-out", "--from", "0,0"}, 2, {"--from", "--arc"});
  refused({"--arc", darkroom / "x", "--from", "0,0"}, 2, {"--to"});
  refused({"--arc", darkroom / "x", "--from", "0,0", "--to", "180,0"}, 2, {"degrees apart"});
  refused({"--arc", darkroom / "x", "--hdr-flip"}, 2, {"--hdr-flip"});
  refused({"--held-out", "--steps", "9"}, 2, {"--steps goes with --arc"});
  refused({"--held-out", "--directions", "9"}, 2, {"--directions", "--off-grid, --subsample, --frontier"});
  refused({"--off-grid", "--every", "9"}, 2, {"--every", "--held-out"});
  refused({"--accuracy", "--method", "rbf"}, 2, {"--method"});
  refused({"--held-out", "--report", ""}, 2, {"--report", "empty"});
  refused({"--held-out", "--method", "all,rbf"}, 2, {"all"});
  refused({"--held-out", "--method", "linear,rbf,linear"}, 2, {"--method names linear twice"});
  refused({"--held-out", "--report", darkroom / "dirs.lp"}, 3, {"dirs.lp"});
  refused({"--held-out", "--method", "rbf", "--metric-model", darkroom / "dirs.lp"}, 3, {"dirs.lp", "TorchScript"});
}
