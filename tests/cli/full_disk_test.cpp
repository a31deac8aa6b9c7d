// A disk without room: said before anything is lit; and one that fills up under a pass.
#include <catch2/catch.hpp>

#include <chrono>
#include <map>
#include <thread>

#include "cli/darkroom.h"
#include "cli/program.h"
#include "core/file.h"
#include "db/store.h"
#include "support/small_disk.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::Outcome;
using test::run_program;
namespace fs = std::filesystem;

namespace {

struct Stage {
  // The store is on the small disk.
  explicit Stage(std::size_t megabytes) : disk((fs::create_directory(folder / "disk"), folder / "disk"), megabytes) {
    if (!disk.problem().empty()) return;
    REQUIRE(run_program(store, {"init"}).status == 0);
    REQUIRE(run_program(store, {"stage", "--lights", "60", "--out", file}).status == 0);
  }
  std::vector<std::string> capture(int size) const {
    return {"capture", "--sim", "--procedural", "3",          "--stage", file, "--size", std::to_string(size),
            "--name",  "head",  "--no-noise",   "--no-motion"};
  }

  test::TemporaryFolder folder;
  test::SmallDisk disk;
  fs::path store = folder / "disk" / "store";
  std::string file = (folder / "stage.toml").string();
};

// Which object each frame is.
std::map<int, std::string> objects(const fs::path& folder) {
  const db::Store store = db::Store::open(folder);
  std::map<int, std::string> objects;
  for (const db::Frame& frame : store.frames(store.scan("head").id)) objects[frame.step_index] = frame.object.hex();
  return objects;
}

}  // namespace

TEST_CASE("a pass that the disk has no room for is refused before anything is lit") {
  const Stage stage(30);
  if (!stage.disk.problem().empty()) SKIP_TEST(stage.disk.problem());
  const Outcome refused = run_program(stage.store, stage.capture(512));  // 74 steps of 1.5 MB
  INFO(refused.err);
  CHECK(refused.status == 5);
  CHECK_THAT(refused.err,
             Contains("capturing 'head' (") && Contains(" frames) needs up to 1") && Contains(" MB free; make room"));
  CHECK(db::Store::open(stage.store).scans().empty());
  CHECK(run_program(stage.store, stage.capture(64)).status == 0);
}

TEST_CASE("a disk that fills up in mid pass ends it between frames; with room again it goes on to the same pictures") {
  const Stage stage(60);
  if (!stage.disk.problem().empty()) SKIP_TEST(stage.disk.problem());
  const fs::path reference = stage.folder / "reference";
  REQUIRE(run_program(reference, {"init"}).status == 0);
  // Without tracking frames: a light that was lit before one is at once as bright in it, and one that was not rises to that, which is a last digit in the
  // frame that a pass goes on with.
  std::vector<std::string> capture = stage.capture(200);
  capture.insert(capture.end(), {"--tracking-every", "0"});
  REQUIRE(run_program(reference, capture).status == 0);

  const fs::path err = stage.folder / "err";
  test::BackgroundRun run(stage.store, capture, err);
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  const auto frames = [&] {
    const db::Store reader = db::Store::open(stage.store);
    const auto scan = reader.find_scan("head");
    return scan ? reader.frames(scan->id).size() : 0;
  };
  while (frames() < 8 && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  stage.disk.fill("ballast");
  CHECK(run.wait() == 5);
  const std::string message = core::read_text_file(err);
  INFO(message);
  CHECK_THAT(message, Contains("o space left on device") || Contains("disk is full") || Contains("disk I/O error"));
  CHECK_THAT(message,
             Contains("what was taken before is stored") && Contains("`lightstage capture --resume --name head`"));

  // What there is no room for is said at once, and changes nothing.
  const Outcome still_full = run_program(stage.store, {"capture", "--resume", "--name", "head"});
  INFO(still_full.err);
  CHECK(still_full.status == 5);
  fs::remove(stage.folder / "disk" / "ballast");
  const std::map<int, std::string> kept = objects(stage.store), expected = objects(reference);
  CHECK(kept.size() >= 8);
  CHECK(kept.size() < expected.size());
  CHECK(run_program(stage.store, {"store", "ls", "--json"}).json()["scans"][0]["missing"] ==
        expected.size() - kept.size());
  for (const auto& [step, object] : kept) CHECK(object == expected.at(step));

  const Outcome resumed = run_program(stage.store, {"capture", "--resume", "--name", "head", "--json"});
  INFO(resumed.err);
  REQUIRE(resumed.status == 0);
  CHECK(resumed.json()["already_stored"] == kept.size());
  CHECK(objects(stage.store) == expected);
  CHECK(run_program(stage.store, {"store", "verify", "--json"}).json()["ok"] == true);
}

TEST_CASE("import, align, superres and backup say at once that the disk has no room") {
  const Stage stage(48);
  if (!stage.disk.problem().empty()) SKIP_TEST(stage.disk.problem());
  const test::Darkroom pictures;
  REQUIRE(run_program(stage.store, stage.capture(64)).status == 0);
  stage.disk.fill("ballast", std::size_t{16} << 20);
  const std::vector<std::vector<std::string>> commands{
      {"import", "lp", pictures / "dirs.lp", "--name", "ball"},
      {"align", "head"},
      {"superres", "head", "--lights", "80", "--method", "linear", "--out", "dense"},
      {"store", "backup", (stage.folder / "disk" / "backup").string()}};
  for (const std::vector<std::string>& command : commands) {
    const Outcome refused = run_program(stage.store, command);
    CAPTURE(command.front(), refused.err);
    CHECK(refused.status == 5);
    CHECK_THAT(refused.err, Contains(" needs up to ") && Contains(" free; make room there"));
  }
  fs::remove(stage.folder / "disk" / "ballast");
  for (const std::vector<std::string>& command : commands) {
    const Outcome done = run_program(stage.store, command);
    CAPTURE(command.front(), done.err);
    CHECK(done.status == 0);
  }
}
