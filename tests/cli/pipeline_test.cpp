// The main job from end to end through the program itself, small.
#include <catch2/catch.hpp>
#include <fstream>
#include <set>

#include "cli/program.h"
#include "core/image_file.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;

namespace {

nlohmann::json succeed(const std::filesystem::path& store, std::vector<std::string> arguments) {
  arguments.push_back("--json");
  const test::Outcome outcome = run_program(store, arguments);
  INFO(arguments.front() << ": " << outcome.err);
  REQUIRE(outcome.status == 0);
  REQUIRE(std::count(outcome.out.begin(), outcome.out.end(), '\n') == 1);
  return outcome.json();
}

}  // namespace

TEST_CASE("a simulated stage is captured, calibrated, aligned, super-resolved, relit and judged") {
  const test::TemporaryFolder folder;
  const std::filesystem::path store = folder / "store";
  const std::string stage = (folder / "stage.toml").string();
  const std::string model = (folder / "head.safetensors").string();
  succeed(store, {"init"});
  CHECK(succeed(store, {"stage", "--lights", "80", "--mount-error", "1", "--gain-spread", "0.05", "--out",
                        stage})["lights"] == 80);
  succeed(store, {"capture", "--sim", "--mirror-ball", "--stage", stage, "--size", "384", "--name", "ball"});
  succeed(store, {"capture", "--sim", "--grey-ball", "--stage", stage, "--size", "96", "--name", "grey"});
  const auto capture = succeed(store, {"capture", "--sim", "--procedural", "3", "--stage", stage, "--size", "96",
                                       "--drop", "20", "--name", "head"});
  CHECK(capture["frames"] == capture["steps"]);
  CHECK(capture["dropped"] == 1);
  CHECK(capture["retaken"] == 1);
  const auto calibration =
      succeed(store, {"calibrate", "ball", "--grey", "grey", "--lp", (folder / "lights.lp").string()});
  CHECK(calibration["placed"].get<int>() > 70);
  CHECK(succeed(store, {"align", "head"})["aligned"] == 80);

  const auto accuracy = succeed(store, {"evaluate", "head", "--accuracy"});
  INFO(accuracy.dump());
  CHECK(accuracy["calibration"]["median_deg"].get<double>() <= 0.25);
  CHECK(accuracy["calibration"]["median_gain_error"].get<double>() <= 0.03);
  CHECK(accuracy["alignment"]["median_epe_px"].get<double>() <= 0.5);
  CHECK(accuracy["alignment"]["psnr_aligned_db"].get<double>() >
        accuracy["alignment"]["psnr_unaligned_db"].get<double>());
  const auto verified = succeed(store, {"store", "verify"});
  CHECK(verified["ok"] == true);
  CHECK(verified["errors"].empty());

  CHECK(succeed(store, {"train", "head", "--steps", "20", "--out", model})["steps"] == 20);
  const auto evaluation = succeed(store, {"evaluate", "head", "--off-grid", "--directions", "5", "--seed", "2",
                                          "--model", model, "--sheet", (folder / "sheet.png").string()});
  CHECK(evaluation["protocol"] == "off-grid");
  double nearest = 0, linear = 0;
  std::set<std::string> judged;
  for (const auto& method : evaluation["methods"]) {
    CHECK(judged.insert(method["name"]).second);
    CHECK(method["images"] == 5);
    CHECK(method["rmse"].get<double>() > 0);
    if (method["name"] != "superres") CHECK(method["rmse"].get<double>() < 0.15);  // that one had 20 steps
    if (method["name"] == "nearest") nearest = method["rmse"].get<double>();
    if (method["name"] == "linear") linear = method["rmse"].get<double>();
  }
  for (const char* method : {"nearest", "linear", "barycentric", "rbf", "bspline", "blend", "superres"}) {
    CHECK(judged.contains(method));
  }
  CHECK(linear < nearest);
  CHECK(core::read_image_size(folder / "sheet.png").width > 400);

  succeed(store, {"superres", "head", "--lights", "20", "--method", "superres", "--model", model, "--out", "dense"});
  CHECK(succeed(store, {"superres", "head", "--lights", "20", "--method", "superres", "--model", model, "--out",
                        "dense"})["already_stored"] == 20);
  succeed(store, {"sky", "--height", "32", "--out", (folder / "sky.exr").string()});
  succeed(store, {"relight", "dense", "--env", (folder / "sky.exr").string(), "--method", "linear", "--out",
                  (folder / "dense.exr").string()});
  succeed(store, {"relight", "head", "--light", "30,20", "--radius", "8", "--samples", "4", "--out",
                  (folder / "soft.exr").string()});
  succeed(store, {"relight", "head", "--env", (folder / "sky.exr").string(), "--method", "linear", "--out",
                  (folder / "sky_lit.exr").string()});
  for (const std::string picture : {"dense", "soft", "sky_lit"}) {
    INFO(picture);
    CHECK(core::read_image_size(folder / (picture + ".png")) == core::ImageSize{96, 96, 3});
    const core::Image image = core::read_image(folder / (picture + ".exr"));
    CHECK(core::quantile(image.values(), 0.99) > 0.01);
  }
  // The new scan resembles the old one: environments add up over all lights, wherever they stand.
  const core::Image dense = core::read_image(folder / "dense.exr"), captured = core::read_image(folder / "sky_lit.exr");
  CHECK(core::quantile(dense.values(), 0.9) == Approx(core::quantile(captured.values(), 0.9)).epsilon(0.4));

  succeed(store, {"export", "head", "--out", (folder / "head-lp").string()});
  const auto imported = succeed(store, {"import", "lp", (folder / "head-lp" / "head.lp").string(), "--name", "again"});
  CHECK(imported["pictures"] == calibration["placed"]);
  CHECK(succeed(store, {"store", "ls"})["scans"].size() == 5);
  CHECK(succeed(store, {"store", "show", "head"})["products"].size() >= 4);
  CHECK(succeed(store, {"store", "verify"})["ok"] == true);
}

TEST_CASE("an uncalibrated capture of a mesh on any layout can be judged off the grid at once") {
  const test::TemporaryFolder folder;
  const std::filesystem::path store = folder / "store";
  const std::string mesh = (folder / "box.obj").string();
  std::ofstream(mesh)
      << "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n"
         "f 5 6 7\nf 5 7 8\nf 2 1 4\nf 2 4 3\nf 6 2 3\nf 6 3 7\nf 1 5 8\nf 1 8 4\nf 8 7 3\nf 8 3 4\nf 1 2 6\nf 1 6 5\n";
  succeed(store, {"init"});
  succeed(store, {"stage", "--layout", "fibonacci", "--lights", "60", "--out", (folder / "stage.toml").string()});
  succeed(store, {"capture", "--sim", "--mesh", mesh, "--stage", (folder / "stage.toml").string(), "--size", "48",
                  "--no-noise", "--no-motion", "--yaw", "30", "--name", "box"});
  const auto evaluation =
      succeed(store, {"evaluate", "box", "--off-grid", "--directions", "6", "--seed", "1", "--method", "rbf,linear"});
  REQUIRE(evaluation["methods"].size() == 2);
  CHECK(evaluation["methods"][0]["name"] == "rbf");
  CHECK(evaluation["methods"][0]["rmse"].get<double>() < 0.1);
  const auto again =
      succeed(store, {"evaluate", "box", "--off-grid", "--directions", "6", "--seed", "1", "--method", "rbf,linear"});
  CHECK(again["methods"][1]["rmse"] == evaluation["methods"][1]["rmse"]);
}
