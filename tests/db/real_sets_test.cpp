// The importers and checks on real photographs.
#include <catch2/catch.hpp>
#include <fstream>
#include <map>
#include <sstream>

#include "core/error.h"
#include "core/light_list.h"
#include "db/importers.h"
#include "db/scan_loader.h"
#include "db/scene.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::real_data;

namespace {

struct Outcome {
  std::size_t lights = 0;
  std::vector<std::string> excluded;  // file names
  std::vector<std::string> errors;    // of verify
};

Outcome import_and_verify(const db::PictureSet& set) {
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  const db::ImportReport report = db::import_pictures(store, set, "set");
  Outcome outcome;
  outcome.lights = db::load_scan(store, "set").scan.light_count();
  for (const db::CalibratedLight& light : report.excluded) {
    outcome.excluded.push_back(set.pictures[std::size_t(light.light_index)].path.filename().string());
  }
  outcome.errors = store.verify().errors;
  return outcome;
}

// Swaps the pictures of pairs of lights far apart, a pair at a time, and demands that verify names both.
void check_swaps(db::PictureSet set, const std::vector<std::pair<std::size_t, std::size_t>>& pairs) {
  for (const auto& [a, b] : pairs) {
    REQUIRE(core::angle_radians(set.pictures[a].direction, set.pictures[b].direction) >
            core::radians_from_degrees(45));
    std::swap(set.pictures[a].path, set.pictures[b].path);
    std::swap(set.pictures[a].intensity, set.pictures[b].intensity);
    const test::TemporaryFolder folder;
    db::Store store = db::Store::create(folder / "store");
    const db::ImportReport report = db::import_pictures(store, set, "set");
    // The importer may set them aside as mislabelled, which is as good; otherwise verify names them.
    std::string found;
    for (const db::CalibratedLight& light : report.excluded)
      found += "(light " + std::to_string(light.light_index) + ")";
    for (const std::string& error : store.verify().errors)
      found += error.substr(0, error.find(": the frame"));
    CHECK_THAT(found, Contains("(light " + std::to_string(a) + ")") &&
                          Contains("(light " + std::to_string(b) + ")"));
    std::swap(set.pictures[a].path, set.pictures[b].path);
    std::swap(set.pictures[a].intensity, set.pictures[b].intensity);
  }
}

const std::vector<std::string> kNone;

}  // namespace

TEST_CASE("DiLiGenT sets come in whole, nothing is set aside or accused") {
  if (real_data("diligent").empty()) SKIP_TEST("no real DiLiGenT sets");
  for (const std::string object : {"ballPNG", "bearPNG", "catPNG"}) {
    const Outcome outcome = import_and_verify(db::read_diligent_set(real_data("diligent/" + object)));
    CHECK(outcome.lights == 96);
    CHECK(outcome.excluded == kNone);
    CHECK(outcome.errors == kNone);
  }
}

TEST_CASE("the 16-bit ball comes in without filenames.txt") {
  if (real_data("diligent_ball16").empty()) SKIP_TEST("no real 16-bit ball");
  const Outcome outcome = import_and_verify(db::read_diligent_set(real_data("diligent_ball16")));
  CHECK(outcome.lights == 96);
  CHECK(outcome.excluded == kNone);
  CHECK(outcome.errors == kNone);
}

TEST_CASE("the RTI dome set comes in whole, nothing is set aside or accused") {
  if (real_data("loewenkopf240").empty()) SKIP_TEST("no real RTI set");
  const Outcome outcome = import_and_verify(db::read_lp_set(real_data("loewenkopf240/dirs.lp")));
  CHECK(outcome.lights == 240);
  CHECK(outcome.excluded == kNone);
  CHECK(outcome.errors == kNone);
}

TEST_CASE("of the real faces the torn and black pictures are set aside and no other") {
  if (real_data("yale_faces").empty()) SKIP_TEST("no real faces");
  const Outcome damaged = import_and_verify(db::read_yale_set(real_data("yale_faces/yaleB02")));
  CHECK(damaged.lights == 61);
  // Two whose rows are interlaced from two flashes, and one that the flash missed.
  CHECK(damaged.excluded == std::vector<std::string>{"yaleB02_P00A+020E-10.pgm", "yaleB02_P00A+025E+00.pgm",
                                                     "yaleB02_P00A+095E+00.pgm"});
  CHECK(damaged.errors == kNone);
  const Outcome sound = import_and_verify(db::read_yale_set(real_data("yale_faces/yaleB07")));
  CHECK(sound.lights == 64);
  CHECK(sound.excluded == kNone);
  CHECK(sound.errors == kNone);
}

TEST_CASE("directions read from the faces' names are those derived by others") {
  const auto folder = real_data("yale_faces/yaleB02");
  if (folder.empty()) SKIP_TEST("no real faces");
  std::map<std::string, core::Vec3> derived;
  std::ifstream list(folder / "light_directions_derived.txt");
  for (std::string line; std::getline(list, line);) {
    std::istringstream words(line);
    std::string file;
    core::Vec3 v;
    if (line[0] != '#' && words >> file >> v.x >> v.y >> v.z) derived[file] = v;
  }
  const db::PictureSet set = db::read_yale_set(folder);
  REQUIRE(set.pictures.size() == 64);
  REQUIRE(derived.size() == 64);
  for (const db::PictureEntry& picture : set.pictures) {
    CHECK(core::norm(picture.direction.vec() - derived.at(picture.path.filename().string())) < 1e-7);
  }
}

TEST_CASE("swapped pictures of real sets are found") {
  if (real_data("yale_faces").empty() || real_data("diligent").empty() ||
      real_data("loewenkopf240").empty()) {
    SKIP_TEST("no real sets");
  }
  check_swaps(db::read_diligent_set(real_data("diligent/catPNG")), {{0, 95}, {7, 88}});
  check_swaps(db::read_lp_set(real_data("loewenkopf240/dirs.lp")), {{10, 235}, {100, 150}});
  check_swaps(db::read_yale_set(real_data("yale_faces/yaleB07")), {{2, 58}, {20, 50}, {10, 29}});
}

TEST_CASE("an ambient picture of another size than its set is refused by name") {
  const auto ambient = real_data("broken/yaleB21_P00_Ambient.pgm");
  const auto faces = real_data("yale_faces/yaleB02");
  if (ambient.empty() || faces.empty()) SKIP_TEST("no real broken pictures");
  const test::TemporaryFolder folder;
  std::filesystem::copy(faces / "yaleB02_P00A+000E+00.pgm", folder / "yaleB21_P00A+000E+00.pgm");
  std::filesystem::copy(ambient, folder.path());
  const std::string message = test::message_of([&] { db::read_yale_set(folder.path()); });
  CHECK_THAT(message, Contains((folder / "yaleB21_P00_Ambient.pgm").string()) && Contains("640x480") &&
                          Contains("168x192"));
}
