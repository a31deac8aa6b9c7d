// Strangers' files and stores given to the program: one clear line, the right exit status, and nothing that moves the terminal's cursor.
#include <SQLiteCpp/Database.h>
#include <sqlite3.h>
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <fstream>

#include "cli/program.h"
#include "core/image_file.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;
namespace fs = std::filesystem;

namespace {

struct Desk {
  test::TemporaryFolder folder;
  fs::path store = folder / "store";

  Desk() {
    REQUIRE(run_program(store, {"init"}).status == 0);
    fs::create_directory(folder / "set");
    core::Image picture(4, 4, 3);
    for (const char* name : {"a.exr", "b.exr"}) core::write_image(folder / "set" / name, picture);
    core::write_image(folder / "secret.exr", picture);
  }

  test::Outcome import_lp(const std::string& list) const {
    std::ofstream(folder / "set/a.lp", std::ios::binary) << list;
    return run_program(store, {"import", "lp", (folder / "set/a.lp").string(), "--name", "x", "--quiet"});
  }

  // One printable line on stderr with all these words in it, and nothing on stdout.
  static void check_refused(const test::Outcome& outcome, int status, const std::vector<std::string>& words) {
    INFO(outcome.err);
    CHECK(outcome.status == status);
    CHECK(outcome.out.empty());
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    CHECK(outcome.err.size() < 700);
    check_harmless(outcome.err);
    for (const std::string& word : words) CHECK(outcome.err.find(word) != std::string::npos);
  }
  static void check_harmless(const std::string& text) {
    CHECK(std::none_of(text.begin(), text.end(), [](unsigned char c) { return (c < 0x20 && c != '\n') || c == 0x7F; }));
  }
};

}  // namespace

TEST_CASE("names in a list are shown as what they are, and followed nowhere else") {
  const Desk desk;
  fs::create_symlink("../secret.exr", desk.folder / "set/link.exr");
  const auto named = [&](const std::string& name) { return desk.import_lp("2\na.exr 0 0 1\n" + name + " 1 0 1\n"); };
  Desk::check_refused(named("/etc/hostname"), 3, {"a.lp: light 2 of 2", "'/etc/hostname' leads out of the folder"});
  Desk::check_refused(named("../secret.exr"), 3, {"leads out"});
  Desk::check_refused(named("link.exr"), 3, {"'link.exr' leads out"});
  Desk::check_refused(named("\x1b]0;owned\x07\x1b[2J"), 3, {"\\x1b]0;owned\\x07", "control character"});
  Desk::check_refused(named(std::string("a\0.exr", 6)), 3, {"a\\x00.exr"});
  Desk::check_refused(named("\xE4\xFF.exr"), 3, {"\\xe4\\xff.exr", "not there"});
  Desk::check_refused(named(std::string(4096, 'n')), 3, {"4096 bytes"});
}

TEST_CASE("what is no file is neither waited for nor read to its end") {
  const Desk desk;
  REQUIRE(mkfifo((desk.folder / "pipe.exr").c_str(), 0600) == 0);
  fs::create_symlink("/dev/zero", desk.folder / "zero.exr");
  const std::string folder = desk.folder.path().string();
  const std::string stage = folder + "/stage.toml";
  REQUIRE(run_program(desk.store, {"stage", "--lights", "24", "--out", stage}).status == 0);
  for (const std::string& file : {folder + "/pipe.exr", std::string("/dev/zero"), folder, folder + "/zero.exr"}) {
    CAPTURE(file);
    const auto run = [&](std::vector<std::string> arguments) { return run_program(desk.store, std::move(arguments)); };
    Desk::check_refused(run({"import", "lp", file, "--name", "x"}), 3, {file});
    Desk::check_refused(run({"model", "show", file}), 3, {file});
    Desk::check_refused(run({"capture", "--sim", "--procedural", "1", "--stage", file, "--name", "x"}), 3, {file});
    Desk::check_refused(run({"capture", "--sim", "--mesh", file, "--stage", stage, "--name", "x"}), 3, {file});
    Desk::check_refused(run({"merge", file, "--exposures", "1", "--out", folder + "/o.exr"}), 3, {file});
  }
}

TEST_CASE("names in a stranger's store do not reach the terminal as they are, nor files") {
  const Desk desk;
  REQUIRE(desk.import_lp("2\na.exr 0 0 1\nb.exr 1 0 1\n").status == 0);
  const auto change = [&](const std::string& sql) {
    SQLite::Database raw((desk.store / "store.sqlite").string(), SQLite::OPEN_READWRITE);
    raw.exec(sql);
  };
  const auto run = [&](std::vector<std::string> arguments) { return run_program(desk.store, std::move(arguments)); };
  change("UPDATE scans SET created_utc = char(27) || ']0;owned' || char(7) || char(155) || '2J'");
  for (const char* form : {"--quiet", "--json"}) {
    const test::Outcome listed = run({"store", "ls", form});
    CHECK(listed.status == 0);
    CHECK(listed.out.find("owned") != std::string::npos);
    CHECK(listed.out.find("\xC2\x9B") == std::string::npos);
    Desk::check_harmless(listed.out);
  }
  CHECK(run({"store", "ls", "--json"}).json()["scans"][0]["created"] ==
        "\x1b]0;owned\x07\xC2\x9B"
        "2J");
  change("UPDATE scans SET name = '../../x'");
  Desk::check_refused(run({"store", "show", "../../x"}), 5, {"cannot name a scan"});
  Desk::check_refused(run({"relight", "../../x", "--light", "0,0,1", "--out", (desk.folder / "o.exr").string()}), 5,
                      {"cannot name a scan"});
  change("UPDATE scans SET name = 'x', kind = 'olat', provenance = '{\"stage_toml\": 1, \"sequence_toml\": 2}'");
  Desk::check_refused(run({"export", "x", "--format", "colmap", "--out", (desk.folder / "o").string()}), 5,
                      {"provenance of scan 'x' is damaged"});
  change("CREATE TRIGGER t AFTER UPDATE ON scans BEGIN DELETE FROM frames; END");
  for (const auto& arguments : std::vector<std::vector<std::string>>{
           {"store", "ls"}, {"store", "verify"}, {"store", "rm", "x", "--yes"}, {"align", "x"}, {"store", "gc"}}) {
    Desk::check_refused(run(arguments), 5, {"trigger 't'"});
  }
}
