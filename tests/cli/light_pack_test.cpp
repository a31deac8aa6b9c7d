// Packed virtual scans as a user makes, uses and breaks them.
#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <fstream>
#include <thread>

#include "cli/darkroom.h"
#include "cli/program.h"
#include "core/image_file.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using test::Darkroom;
namespace fs = std::filesystem;

namespace {

const std::vector<std::string> kPack{"superres", "ball",  "--lights",   "90",      "--method", "barycentric",
                                     "--out",    "dense", "--compress", "--quiet", "--json"};

nlohmann::json packed(const Darkroom& darkroom) {
  const test::Outcome outcome = darkroom.run(kPack);
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  return outcome.json();
}

test::Outcome relit(const Darkroom& darkroom, const std::string& out, std::vector<std::string> more) {
  core::Image map(8, 16, 3);
  for (std::size_t i = 0; i < map.values().size(); ++i) map.values()[i] = float(i % 5);
  core::write_image(darkroom / "map.exr", map);
  std::vector<std::string> arguments{"relight", "dense",        "--env", darkroom / "map.exr",
                                     "--out",   darkroom / out, "--json"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return darkroom.run(arguments);
}

void check_one_line(const test::Outcome& outcome, int status, const std::vector<std::string>& said) {
  INFO(outcome.err);
  CHECK(outcome.status == status);
  CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
  for (const std::string& text : said) CHECK(outcome.err.find(text) != std::string::npos);
}

fs::path basis_picture(const Darkroom& darkroom, std::size_t k) {
  const db::Store store = db::Store::open(darkroom.store());
  const auto product = store.newest_product("light_pack", store.scan("dense").id);
  REQUIRE(product);
  for (const db::ProductImage& image : product->images)
    if (image.role == "basis" && std::size_t(image.index) == k) return store.object_path(image.object);
  FAIL("no such basis picture");
  return {};
}

}  // namespace

TEST_CASE("a virtual scan is relit by its pack unless another method is asked for") {
  const Darkroom darkroom;
  const nlohmann::json made = packed(darkroom);
  const nlohmann::json& pack = made.at("pack");
  CHECK(made.at("lights") == 90);
  CHECK(pack.at("asked_error") == 0.01);
  CHECK(pack.at("error").get<double>() <= 0.01);
  CHECK(pack.at("error").get<double>() > 0);
  CHECK(pack.at("display_error").get<double>() > 0);
  CHECK(pack.at("largest_light_error") > pack.at("error"));
  CHECK(pack.at("rank").get<int>() < 30);
  CHECK(pack.at("bytes").get<double>() < pack.at("scan_bytes").get<double>());
  CHECK(pack.at("already_stored") == false);

  const test::Outcome by_pack = relit(darkroom, "pack.exr", {}),
                      whole = relit(darkroom, "whole.exr", {"--method", "barycentric"});
  for (const test::Outcome* outcome : {&by_pack, &whole}) {
    INFO(outcome->err);
    REQUIRE(outcome->status == 0);
  }
  CHECK(by_pack.json().at("method") == "pack");
  CHECK(by_pack.json().at("directions_synthesised") == 0);
  CHECK(by_pack.json().at("pack").at("error") == pack.at("error"));
  CHECK(by_pack.json().at("seconds_preparing").get<double>() > 0);
  CHECK(whole.json().at("method") == "barycentric");
  CHECK_FALSE(whole.json().contains("pack"));
  const core::Image a = core::read_image(darkroom / "pack.exr"), b = core::read_image(darkroom / "whole.exr");
  double squared = 0, energy = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i) {
    squared += std::pow(double(a.values()[i]) - double(b.values()[i]), 2);
    energy += std::pow(double(b.values()[i]), 2);
  }
  CHECK(squared > 0);
  CHECK(std::sqrt(squared / energy) < 0.01);
}

TEST_CASE("a virtual scan is packed once for an error, the newest pack is taken, and packs go with their scan") {
  const Darkroom darkroom;
  packed(darkroom);
  CHECK(packed(darkroom).at("pack").at("already_stored") == true);
  std::vector<std::string> command = kPack;
  command.insert(command.end(), {"--compress-error", "0.003"});
  const test::Outcome finer = darkroom.run(command);
  INFO(finer.err);
  REQUIRE(finer.status == 0);
  CHECK(finer.json().at("pack").at("error").get<double>() <= 0.003);
  CHECK(relit(darkroom, "finer.exr", {"--method", "pack"}).json().at("pack").at("asked_error") == 0.003);
  CHECK(darkroom.run({"store", "verify", "--json"}).json().at("ok") == true);
  CHECK(darkroom.run({"store", "rm", "dense", "--yes"}).status == 0);
}

TEST_CASE("a damaged or missing pack is named by verify and by relight, and made again by the command that made it") {
  const Darkroom darkroom;
  packed(darkroom);
  const fs::path picture = basis_picture(darkroom, 1);
  std::error_code error;
  fs::permissions(picture, fs::perms::owner_write, fs::perm_options::add, error);
  SECTION("damaged") {
    std::ofstream(picture, std::ios::binary | std::ios::app) << "more";
  }
  SECTION("missing") {
    fs::remove(picture);
  }
  const test::Outcome verified = darkroom.run({"store", "verify", "--json", "--quiet"});
  CHECK(verified.status == 5);
  REQUIRE(verified.json().at("errors").size() == 1);
  CHECK(verified.json().at("errors").at(0).get<std::string>().find("light_pack") == 0);
  check_one_line(relit(darkroom, "out.exr", {}), 5, {picture.stem().string()});
  CHECK_FALSE(fs::exists(darkroom / "out.exr"));
  CHECK(relit(darkroom, "out.exr", {"--method", "barycentric"}).status == 0);

  const test::Outcome again = darkroom.run(kPack);
  check_one_line(again, 0, {"warning", picture.stem().string()});
  CHECK(again.json().at("pack").at("already_stored") == false);
  CHECK(relit(darkroom, "out.exr", {}).status == 0);
  CHECK(darkroom.run({"store", "verify", "--json"}).json().at("ok") == true);
}

TEST_CASE("packs that are not there or from another program are refused in one line") {
  const Darkroom darkroom;
  check_one_line(darkroom.run({"relight", "ball", "--light", "0,0,1", "--method", "pack", "--out", darkroom / "a.exr"}),
                 2, {"no pack", "--compress"});
  check_one_line(darkroom.run({"superres", "ball", "--lights", "9", "--out", "x", "--compress-error", "0.1"}), 2,
                 {"--compress"});
  check_one_line(
      darkroom.run({"superres", "ball", "--lights", "9", "--out", "x", "--compress", "--compress-error", "0"}), 2,
      {"0.001"});
  packed(darkroom);
  check_one_line(relit(darkroom, "a.exr", {"--method", "pack", "--domain", "linear"}), 2, {"no knobs"});
  {
    db::Store store = db::Store::open(darkroom.store());
    db::NewProduct newer = *store.newest_product("light_pack", store.scan("dense").id);
    newer.parameters = R"({"format": 2})";
    store.add_product(newer);
  }
  check_one_line(relit(darkroom, "a.exr", {}), 5, {"light_pack", "another version", "superres"});
  {
    db::Store store = db::Store::open(darkroom.store());
    db::NewProduct torn = store.products("light_pack").front();
    torn.images.pop_back();
    torn.images.erase(torn.images.begin());
    store.add_product(torn);
  }
  check_one_line(relit(darkroom, "a.exr", {}), 5, {"light_pack", "lacks"});
}

TEST_CASE("superres --compress that was interrupted goes on by the same command") {
  const Darkroom darkroom;
  std::vector<std::string> command = kPack;
  command[3] = "400";
  for (const int signal : {SIGKILL, SIGINT}) {
    test::BackgroundRun run(darkroom.store(), command);
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    const std::size_t wanted = signal == SIGKILL ? 40 : 100;
    for (std::size_t frames = 0; frames < wanted && std::chrono::steady_clock::now() < deadline;) {
      const db::Store store = db::Store::open(darkroom.store());
      const auto scan = store.find_scan("dense");
      frames = scan ? store.frames(scan->id).size() : 0;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    run.signal(signal);
    CHECK(run.wait() != 0);
    const db::Store store = db::Store::open(darkroom.store());
    CHECK_FALSE(store.newest_product("light_pack", store.scan("dense").id));
  }
  const test::Outcome resumed = darkroom.run(command);
  INFO(resumed.err);
  REQUIRE(resumed.status == 0);
  CHECK(resumed.json().at("already_stored").get<int>() >= 100);
  CHECK(relit(darkroom, "out.exr", {}).json().at("method") == "pack");
  CHECK(darkroom.run({"store", "verify", "--json"}).json().at("ok") == true);
}
