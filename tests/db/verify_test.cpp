#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <SQLiteCpp/SQLiteCpp.h>
#include <catch2/catch.hpp>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <random>
#include <thread>

#include "core/image_file.h"
#include "core/light_list.h"
#include "db/check/misplaced.h"
#include "db/check/thumbnail.h"
#include "db/importers.h"
#include "db/scene.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using Catch::Matchers::Equals;
namespace fs = std::filesystem;

namespace {

const std::vector<core::Direction>& stage_lights() {
  static const std::vector<core::Direction> lights = test::front_lights(40);
  return lights;
}

// A calibrated scan of 40 lights, sound in every way.
void fill(const fs::path& folder) {
  db::Store store = db::Store::create(folder);
  const db::Id scan_id = store.add_scan(test::olat_scan("head", 40));
  std::vector<db::CalibratedLight> calibrated;
  for (std::size_t i = 0; i < stage_lights().size(); ++i) {
    store.put_frame({.scan_id = scan_id, .camera = "main", .step_index = int(i)},
                    test::lit_ball(stage_lights()[i], 40, 48));
    db::CalibratedLight entry;
    entry.light_index = int(i);
    entry.light.direction = stage_lights()[i];
    calibrated.push_back(entry);
  }
  db::NewProduct product;
  product.kind = "calibration";
  product.stage_key = "stage";
  store.add_calibration(product, calibrated);
}

// A copy of it for each test: copying does not wait for the disk, filling does.
fs::path fresh_copy(const fs::path& folder) {
  static const test::TemporaryFolder original;
  if (!fs::exists(original / "store")) fill(original / "store");
  fs::copy(original / "store", folder, fs::copy_options::recursive);
  return folder;
}

struct Fixture {
  test::TemporaryFolder folder;
  db::Store store = db::Store::open(fresh_copy(folder / "store"));
  std::vector<core::Direction> lights = stage_lights();
  db::Id scan_id = store.scan("head").id;

  void put(std::size_t step, const core::Direction& light) {
    store.put_frame({.scan_id = scan_id, .camera = "main", .step_index = int(step)}, test::lit_ball(light, 40, 48));
  }
  fs::path object_of(std::size_t step) const { return store.object_path(store.frames(scan_id)[step].object); }
};

// This program again, running one hidden test case in the folder, until it is killed.
class Victim {
 public:
  Victim(std::string test_case, const fs::path& folder) {
    // Not /proc/self/exe, which under Valgrind is its own program.
    std::string program = fs::read_symlink("/proc/self/exe").string(),
                variable = "LIGHTSTAGE_TEST_VICTIM=" + folder.string();
    std::array<char*, 3> arguments{program.data(), test_case.data(), nullptr};
    std::array<char*, 2> environment{variable.data(), nullptr};
    posix_spawn_file_actions_t quiet;
    posix_spawn_file_actions_init(&quiet);
    posix_spawn_file_actions_addopen(&quiet, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&quiet, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    if (posix_spawn(&process_, program.c_str(), &quiet, nullptr, arguments.data(), environment.data()) != 0)
      process_ = -1;
    posix_spawn_file_actions_destroy(&quiet);
  }
  ~Victim() { kill(); }
  Victim(const Victim&) = delete;
  Victim& operator=(const Victim&) = delete;

  // Whether it was still alive.
  bool kill() {
    if (process_ <= 0) return false;
    ::kill(process_, SIGKILL);
    int status = 0;
    const bool reaped = waitpid(process_, &status, 0) == process_;
    process_ = -1;
    return reaped && WIFSIGNALED(status);
  }

 private:
  pid_t process_ = -1;
};

}  // namespace

TEST_CASE_METHOD(Fixture, "a sound store is found sound") {
  const db::VerifyReport report = store.verify();
  CHECK(report.errors == std::vector<std::string>());
  CHECK(report.notes == std::vector<std::string>());
  CHECK(report.frames == 40);
  CHECK(report.objects == 40);
}

TEST_CASE_METHOD(Fixture, "truncated, changed and missing objects are named with their frames") {
  const auto frames = store.frames(scan_id);
  fs::resize_file(object_of(3), fs::file_size(object_of(3)) / 2);
  std::string bytes = test::read_text(object_of(7));
  bytes[bytes.size() / 2] = char(bytes[bytes.size() / 2] ^ 1);
  test::write_text(object_of(7), bytes);
  fs::remove(object_of(11));
  const auto errors = store.verify().errors;
  REQUIRE(errors.size() == 3);
  const auto one_of = [&](const std::string& line) { return std::count(errors.begin(), errors.end(), line) == 1; };
  const auto line = [&](std::size_t step, const std::string& problem) {
    return "scan 'head', step " + std::to_string(step) + ", camera 'main': object " + frames[step].object.hex() + " " +
           problem;
  };
  CHECK(one_of(line(3, "is damaged: its bytes do not match its name")));
  CHECK(one_of(line(7, "is damaged: its bytes do not match its name")));
  CHECK(one_of(line(11, "is missing")));
}

TEST_CASE_METHOD(Fixture, "missing frames are an error, orphans and stray files only a note") {
  store.add_scan(test::olat_scan("half", 3));
  const db::ContentHash orphan = store.put_object(test::half_pattern(4, 4, 3, 1));
  test::write_text(store.folder() / "objects/incoming-1-2.exr", "half written");
  db::VerifyReport report = store.verify();
  REQUIRE(report.errors.size() == 1);
  CHECK(report.errors[0] ==
        "scan 'half', step 0 (light 0), camera 'main': the frame is missing, the first of 3 that are; an interrupted "
        "pass goes on with "
        "`lightstage capture --resume --name half`");
  REQUIRE(report.notes.size() == 2);
  CHECK_THAT(report.notes[0], Contains("1 object belongs to no frame or product"));
  CHECK_THAT(report.notes[1], Contains("incoming-1-2.exr"));
  CHECK(report.objects == 41);
  fs::resize_file(store.object_path(orphan), 10);
  report = store.verify();
  REQUIRE(report.errors.size() == 2);
  CHECK(report.errors[1] == "object " + orphan.hex() + " is damaged: its bytes do not match its name");
}

TEST_CASE_METHOD(Fixture, "two swapped frames are both named") {
  // The lights of the largest angle, and two of a middling one.
  for (const auto& [a, b] : {std::pair<std::size_t, std::size_t>{0, 39}, {5, 30}}) {
    REQUIRE(core::angle_radians(lights[a], lights[b]) > core::radians_from_degrees(45));
    put(a, lights[b]);
    put(b, lights[a]);
    const auto errors = store.verify().errors;
    const auto label = [](std::size_t i) { return "step " + std::to_string(i) + " (light " + std::to_string(i) + ")"; };
    REQUIRE(errors.size() == 2);
    CHECK(errors[0] ==
          "scan 'head', camera 'main', " + label(a) + ": the frame seems swapped with that of " + label(b));
    CHECK(errors[1] ==
          "scan 'head', camera 'main', " + label(b) + ": the frame seems swapped with that of " + label(a));
    put(a, lights[a]);
    put(b, lights[b]);
  }
  CHECK(store.verify().errors.empty());
}

TEST_CASE_METHOD(Fixture, "a frame taken under another light is named") {
  put(4, lights[37]);
  const auto errors = store.verify().errors;
  REQUIRE(errors.size() == 1);
  CHECK_THAT(errors[0], Contains("step 4 (light 4): the frame does not fit those of the lights around; it resembles"));
}

TEST_CASE_METHOD(Fixture, "a mask of another size than the frames is named") {
  db::NewProduct product;
  product.kind = "mask";
  product.scan_id = scan_id;
  product.images = {{"mask", 0, store.put_object(test::half_pattern(20, 20, 1, 0)), 0}};
  store.add_product(product);
  CHECK(store.verify().errors ==
        std::vector<std::string>{"scan 'head', camera 'main': the mask is not of the size of the frames"});
}

TEST_CASE_METHOD(Fixture, "a mirror ball is not judged by its shading") {
  db::NewScan ball = test::olat_scan("ball", 40);
  ball.kind = db::ScanKind::kMirrorBall;
  const db::Id id = store.add_scan(ball);
  for (int i = 0; i < 40; ++i) {
    store.put_frame({.scan_id = id, .camera = "main", .step_index = i},
                    test::lit_ball(lights[std::size_t(39 - i)], 20, 20));
  }
  CHECK(store.verify().errors.empty());
}

TEST_CASE("pictures without shading accuse nobody") {
  const auto lights = test::front_lights(30);
  for (const float level : {0.0F, 0.5F}) {
    std::vector<core::Image> flat;
    for (std::size_t i = 0; i < lights.size(); ++i) {
      flat.emplace_back(8, 8, 1);
      // A painted board: the same pattern from everywhere, only brighter or darker.
      for (int p = 0; p < 64; ++p)
        flat.back().values()[std::size_t(p)] = level * float(1 + p % 5) * float(lights[i].z());
    }
    CHECK(db::find_misplaced(lights, flat, {}).empty());
  }
  CHECK(db::find_misplaced({}, {}, {}).empty());

  // A white card under near lights, down to grazing ones: their distance, the lens and noise, of which the last is all that these show.
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.003);
  std::vector<core::Direction> around;
  std::vector<core::Image> cards;
  constexpr int kLights = 42, kSide = 8;
  for (int i = 0; i < kLights; ++i) {
    const double z = 0.005 + 0.99 * i / kLights, r = std::sqrt(1 - z * z), turn = 2.399963 * i;
    around.push_back(core::Direction::from_vector({r * std::cos(turn), r * std::sin(turn), z}));
    core::Image card(kSide, kSide, 1);
    for (int row = 0; row < kSide; ++row) {
      for (int column = 0; column < kSide; ++column) {
        const core::Vec3 point{0.16 * (column - 3.5) / 4, -0.16 * (row - 3.5) / 4, 0};
        const core::Vec3 to_light = around.back().vec() * 1.5 - point;
        const double vignetting = 1 - 3 * (point.x * point.x + point.y * point.y);
        const double light = 3.375 * to_light.z / std::pow(norm(to_light), 3) / 1.5;
        card(row, column) = float(std::max(0.0, 0.5 * vignetting * light + noise(random)));
      }
    }
    cards.push_back(std::move(card));
  }
  CHECK(db::find_misplaced(around, cards, {}).empty());
}

TEST_CASE_METHOD(Fixture, "a catalogue with a foreign table or a dangling row is found out") {
  const std::string path = (store.folder() / "store.sqlite").string();
  SQLite::Database raw(path, SQLite::OPEN_READWRITE);
  SECTION("table") {
    raw.exec("CREATE TABLE extra (x)");
    const auto errors = store.verify().errors;
    REQUIRE(errors.size() == 1);
    CHECK(errors[0] == "catalogue: its tables are not those of schema version 2");
  }
  SECTION("row") {
    raw.exec("PRAGMA foreign_keys = OFF");
    raw.exec("DELETE FROM cameras");
    const auto errors = store.verify().errors;
    REQUIRE_FALSE(errors.empty());
    CHECK_THAT(errors[0], Contains("a row of table frames") && Contains("refers to nothing in table cameras"));
  }
}

TEST_CASE("import until killed", "[.child]") {
  // Not a test of its own: the victim of the next one.
  const char* folder = std::getenv("LIGHTSTAGE_TEST_VICTIM");
  if (folder == nullptr) return;
  db::Store store = db::Store::open(fs::path(folder) / "store");
  for (int i = 0;; ++i) {
    db::import_pictures(store, db::read_lp_set(fs::path(folder) / "set/a.lp"), "scan" + std::to_string(i));
  }
}

TEST_CASE("killing an import leaves whole scans only") {
  const test::TemporaryFolder folder;
  { db::Store::create(folder / "store"); }
  fs::create_directory(folder / "set");
  std::vector<core::LpEntry> entries;
  const auto lights = test::front_lights(12);
  for (std::size_t i = 0; i < lights.size(); ++i) {
    entries.push_back({"p" + std::to_string(i) + ".exr", lights[i]});
    core::write_image(folder / "set" / entries.back().name, test::lit_ball(lights[i], 64, 64));
  }
  core::write_lp(folder / "set/a.lp", entries);

  std::size_t whole_scans = 0;
  for (int round = 0; round < 4; ++round) {
    db::Store store = db::Store::open(folder / "store");
    for (const db::Scan& scan : store.scans()) store.remove_scan(scan.id);  // names are free again
    Victim victim("import until killed", folder.path());
    // The first is killed in the middle of its first import, the others a while after that.
    const auto started = [&] { return round == 0 ? !fs::is_empty(folder / "store/objects") : !store.scans().empty(); };
    for (int waited = 0; !started() && waited < 20'000; ++waited)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    std::this_thread::sleep_for(std::chrono::milliseconds(17 * round));
    CHECK(victim.kill());

    whole_scans += store.scans().size();
    for (const db::Scan& scan : store.scans()) {
      CHECK(store.frames(scan.id).size() == 12);
      CHECK(store.newest_calibration(scan.stage_key));
    }
    CHECK(store.verify().errors == std::vector<std::string>());
  }
  CHECK(whole_scans >= 3);
}
