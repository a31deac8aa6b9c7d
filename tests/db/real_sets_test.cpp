// The importers and checks on real photographs.
#include <catch2/catch.hpp>
#include <fstream>
#include <map>
#include <random>
#include <sstream>

#include "core/error.h"
#include "core/image_file.h"
#include "core/light_list.h"
#include "core/sphere.h"
#include "db/check/damaged.h"
#include "db/check/misplaced.h"
#include "db/check/swapped.h"
#include "db/check/thumbnail.h"
#include "db/importers.h"
#include "db/load/light_image.h"
#include "db/scan_loader.h"
#include "db/scene.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::real_data;

namespace {

// What the checks of importer and `verify` look at, taken from the pictures without a store between: syncing each
// object would make these tests slow.
struct Looked {
  std::vector<std::string> names;
  std::vector<core::Direction> directions;
  std::vector<db::DamageFeatures> features;
  std::vector<core::Image> shapes;
  db::DamageFeatures damage_mask;
  core::Image shape_mask;

  explicit Looked(const db::PictureSet& set) {
    const core::ReadOptions options{.encoding = set.encoding};
    core::Image ambient;
    if (set.ambient) ambient = core::read_image(*set.ambient, options);
    for (const db::PictureEntry& picture : set.pictures) {
      core::Image image = core::read_image(picture.path, options);
      db::subtract_dark(image, ambient);
      db::divide_by_gain(image, picture.intensity);
      names.push_back(picture.path.filename().string());
      directions.push_back(picture.direction);
      features.push_back({db::thumbnail(image, db::kDamageSide), db::row_detail(image, db::kDetailSide)});
      shapes.push_back(db::thumbnail(image, db::kShapeSide));
    }
    if (set.mask) {
      const core::Image mask = core::read_image(*set.mask);
      damage_mask = {db::thumbnail(mask, db::kDamageSide), db::thumbnail(mask, db::kDetailSide)};
      shape_mask = db::thumbnail(mask, db::kShapeSide);
    }
  }

  std::vector<std::string> damaged() const {
    std::vector<std::string> found;
    std::vector<core::Image> pictures;
    for (const db::DamageFeatures& f : features) pictures.push_back(f.shape);
    for (const db::Damage& black : db::find_black(directions, pictures, damage_mask.shape))
      found.push_back(names[black.index]);
    for (const db::Damage& damage : db::find_damaged(directions, features, damage_mask)) {
      found.push_back(names[damage.index]);
    }
    return found;
  }
  std::vector<std::pair<std::size_t, std::size_t>> swapped() const {
    return db::find_swapped(directions, shapes, shape_mask);
  }
  std::vector<db::Misplaced> misplaced() const { return db::find_misplaced(directions, shapes, shape_mask); }
};

// Swaps `count` pairs of lights at least 45 degrees apart, one pair at a time; every one must be found, and nothing else.
void check_swaps(Looked set, std::size_t count) {
  std::mt19937 random(1);
  for (std::size_t i = 0; i < count;) {
    const std::size_t a = random() % set.names.size(), b = random() % set.names.size();
    if (core::angle_radians(set.directions[a], set.directions[b]) < core::radians_from_degrees(45)) continue;
    ++i;
    std::swap(set.shapes[a], set.shapes[b]);
    std::vector<std::size_t> found;
    for (const db::Misplaced& misplaced : set.misplaced()) found.push_back(misplaced.index);
    INFO(set.names[a] << " and " << set.names[b] << " were swapped");
    CHECK(found == std::vector<std::size_t>{std::min(a, b), std::max(a, b)});
    std::swap(set.shapes[a], set.shapes[b]);
  }
}

// Swaps neighbours, one pair at a time; every one must be found, and nothing else.
void check_neighbours_swapped(Looked set, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t a = i * set.names.size() / count;
    const std::size_t b = core::nearest_indices(set.directions, set.directions[a], 2).back();
    std::swap(set.shapes[a], set.shapes[b]);
    INFO(set.names[a] << " and " << set.names[b] << " were swapped");
    const std::vector<std::pair<std::size_t, std::size_t>> expected{std::minmax(a, b)};
    CHECK(set.swapped() == expected);
    std::swap(set.shapes[a], set.shapes[b]);
  }
}

const std::vector<std::string> kNone;

}  // namespace

TEST_CASE("nothing of the sound real sets is set aside or accused, and every swap in them is found", "[long]") {
  if (real_data("diligent").empty() || real_data("loewenkopf240").empty() || real_data("yale_faces").empty()) {
    SKIP_TEST("no real sets");
  }
  std::vector<db::PictureSet> sets;
  for (const std::string object : {"diligent/ballPNG", "diligent/bearPNG", "diligent/catPNG", "diligent_ball16"}) {
    sets.push_back(db::read_diligent_set(real_data(object)));
    CHECK(sets.back().pictures.size() == 96);
    CHECK(sets.back().mask);
  }
  sets.push_back(db::read_lp_set(real_data("loewenkopf240/dirs.lp")));
  CHECK(sets.back().pictures.size() == 240);
  sets.push_back(db::read_yale_set(real_data("yale_faces/yaleB07")));
  CHECK(sets.back().pictures.size() == 64);
  for (const db::PictureSet& set : sets) {
    INFO(set.source.string());
    const Looked looked(set);
    CHECK(looked.damaged() == kNone);
    CHECK(looked.misplaced().empty());
    CHECK(looked.swapped().empty());
    check_swaps(looked, 10);
    check_neighbours_swapped(looked, 20);
  }
}

TEST_CASE("of the real faces the torn and black pictures are set aside and no other") {
  if (real_data("yale_faces").empty()) SKIP_TEST("no real faces");
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  const db::PictureSet set = db::read_yale_set(real_data("yale_faces/yaleB02"));
  const db::ImportReport report = db::import_pictures(store, set, "face");
  // Two whose rows are interlaced from two flashes, and one that the flash missed.
  std::vector<std::string> excluded;
  for (const db::CalibratedLight& light : report.excluded) {
    excluded.push_back(set.pictures[std::size_t(light.light_index)].path.filename().string());
  }
  CHECK(excluded ==
        std::vector<std::string>{"yaleB02_P00A+020E-10.pgm", "yaleB02_P00A+025E+00.pgm", "yaleB02_P00A+095E+00.pgm"});
  CHECK(db::load_scan(store, "face").scan.light_count() == 61);
  CHECK(store.verify().errors == kNone);
}

TEST_CASE("a real set comes in, and a swap in it is named by verify") {
  if (real_data("diligent").empty()) SKIP_TEST("no real DiLiGenT sets");
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  db::PictureSet set = db::read_diligent_set(real_data("diligent/ballPNG"));
  set.pictures.resize(48);  // half of the lights are enough here
  std::swap(set.pictures[0].path, set.pictures[47].path);
  const db::ImportReport report = db::import_pictures(store, set, "ball");
  CHECK(report.pictures == 48);
  // The importer may set them aside as mislabelled, which is as good; verify names those that are in use.
  std::string found;
  for (const db::CalibratedLight& light : report.excluded)
    found += " (light " + std::to_string(light.light_index) + ")";
  for (const std::string& error : store.verify().errors) found += error;
  CHECK_THAT(found, Contains("(light 0)") && Contains("(light 47)"));
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

TEST_CASE("an ambient picture of another size than its set is refused by name") {
  const auto ambient = real_data("broken/yaleB21_P00_Ambient.pgm");
  const auto faces = real_data("yale_faces/yaleB02");
  if (ambient.empty() || faces.empty()) SKIP_TEST("no real broken pictures");
  const test::TemporaryFolder folder;
  std::filesystem::copy(faces / "yaleB02_P00A+000E+00.pgm", folder / "yaleB21_P00A+000E+00.pgm");
  std::filesystem::copy(ambient, folder.path());
  const std::string message = test::message_of([&] { db::read_yale_set(folder.path()); });
  CHECK_THAT(message,
             Contains((folder / "yaleB21_P00_Ambient.pgm").string()) && Contains("640x480") && Contains("168x192"));
}
