// The main job on real photographs, on a reduced copy of a published set.
#include <catch2/catch.hpp>
#include <fstream>
#include <sstream>

#include "cli/program.h"
#include "core/image_file.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;
namespace fs = std::filesystem;

namespace {

// Every n-th line of a list.
void thin_list(const fs::path& from, const fs::path& to, int every) {
  std::ifstream in(from);
  std::ofstream out(to);
  int index = 0;
  for (std::string line; std::getline(in, line); ++index) {
    if (index % every == 0) out << line << "\n";
  }
}

nlohmann::json succeed(const fs::path& store, std::vector<std::string> arguments) {
  arguments.push_back("--json");
  const test::Outcome outcome = run_program(store, arguments);
  INFO(arguments.front() << ": " << outcome.err);
  REQUIRE(outcome.status == 0);
  return outcome.json();
}

}  // namespace

TEST_CASE("real photographs are imported, relit, super-resolved by blending and by a network, and judged held out") {
  const fs::path source = test::real_data("diligent/bearPNG");
  if (source.empty()) SKIP_TEST("the DiLiGenT photographs are not here");
  const test::TemporaryFolder folder;
  const fs::path set = folder / "bear";
  fs::create_directory(set);
  constexpr int kEvery = 3;  // 32 of 96 lights
  for (const std::string list : {"filenames.txt", "light_directions.txt", "light_intensities.txt"}) {
    thin_list(source / list, set / list, kEvery);
  }
  std::ifstream names(set / "filenames.txt");
  for (std::string name; names >> name;) fs::copy_file(source / name, set / name);
  fs::copy_file(source / "mask.png", set / "mask.png");

  const fs::path store = folder / "store";
  const std::string model = (folder / "bear.safetensors").string();
  succeed(store, {"init"});
  const auto imported = succeed(store, {"import", "diligent", set.string(), "--name", "bear"});
  CHECK(imported["pictures"] == 32);
  CHECK(imported["excluded"].empty());
  succeed(store,
          {"relight", "bear", "--light", "0.2,0.3,0.9", "--method", "rbf", "--out", (folder / "lit.exr").string()});
  succeed(store, {"superres", "bear", "--lights", "10", "--method", "linear", "--out", "bear-linear"});
  succeed(store, {"train", "bear", "--steps", "30", "--hold-out-every", "8", "--out", model});
  succeed(store,
          {"superres", "bear", "--lights", "10", "--method", "superres", "--model", model, "--out", "bear-network"});
  const auto evaluation = succeed(store, {"evaluate", "bear", "--held-out", "--every", "8", "--method",
                                          "superres,rbf,linear,nearest", "--model", model, "--linear"});
  REQUIRE(evaluation["methods"].size() == 4);
  double linear = 0, nearest = 0;
  for (const auto& method : evaluation["methods"]) {
    CHECK(method["images"] == 4);
    if (method["name"] == "linear") linear = method["rmse"].get<double>();
    if (method["name"] == "nearest") nearest = method["rmse"].get<double>();
  }
  CHECK(linear > 0);
  CHECK(linear < nearest);
}

TEST_CASE("RTI sets and face sets import with their own conventions") {
  const fs::path lion = test::real_data("loewenkopf240");
  const fs::path face = test::real_data("yale_faces/yaleB02");
  if (lion.empty() || face.empty()) SKIP_TEST("the lion head or the Yale faces are not here");
  const test::TemporaryFolder folder;
  const fs::path store = folder / "store";
  succeed(store, {"init"});
  CHECK(succeed(store, {"import", "lp", (lion / "dirs.lp").string(), "--name", "lion"})["pictures"] == 240);
  CHECK(succeed(store, {"import", "yale", face.string(), "--name", "face"})["pictures"] == 64);
  const auto evaluation = succeed(store, {"evaluate", "lion", "--held-out", "--every", "24", "--method", "rbf,linear"});
  CHECK(evaluation["methods"][0]["rmse"].get<double>() < evaluation["methods"][1]["rmse"].get<double>());
}
