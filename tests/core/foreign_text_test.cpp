// Text and paths that somebody else wrote.
#include <catch2/catch.hpp>
#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>

#include "core/child_process.h"
#include "core/config.h"
#include "core/error.h"
#include "core/failure.h"
#include "core/foreign_path.h"
#include "core/nesting.h"
#include "core/printable.h"
#include "support/support.h"

namespace fs = std::filesystem;
using namespace lightstage;
using namespace std::string_literals;

TEST_CASE("what is not printable is shown as an escape") {
  CHECK(core::printable("Gesicht \xC3\xA4 \xE2\x9C\x93 \xF0\x9F\x92\xA1") ==
        "Gesicht \xC3\xA4 \xE2\x9C\x93 \xF0\x9F\x92\xA1");
  CHECK(core::printable("a\nb\tc\r") == "a\\nb\\tc\\r");
  CHECK(core::printable("\x1b]0;title\x07") == "\\x1b]0;title\\x07");
  CHECK(core::printable("nul\0!"s) == "nul\\x00!");
  CHECK(core::printable("\x7F") == "\\x7f");
  CHECK(core::printable("\xC2\x9B"
                        "31m") == "\\xc2\\x9b31m");  // the one-character form of ESC [
  CHECK(core::printable("\xE2\x80\xAEtxt.exe") == "\\u202etxt.exe");
  // Not UTF-8: Latin-1, overlong, a surrogate, past the end of Unicode, cut off.
  CHECK(core::printable("\xE4x") == "\\xe4x");
  CHECK(core::printable("\xC0\xAF") == "\\xc0\\xaf");
  CHECK(core::printable("\xE0\x80\xAF") == "\\xe0\\x80\\xaf");
  CHECK(core::printable("\xED\xA0\x80") == "\\xed\\xa0\\x80");
  CHECK(core::printable("\xF4\x90\x80\x80") == "\\xf4\\x90\\x80\\x80");
  CHECK(core::printable("\xE2\x9C") == "\\xe2\\x9c");
  CHECK(core::printable_lines("a\nb\tc\x1b") == "a\nb\tc\\x1b");
}

TEST_CASE("every byte and every pair of bytes becomes one line without control characters, and stays as it is then") {
  for (int a = 0; a < 256; ++a) {
    for (int b = 0; b < 256; ++b) {
      const std::string shown = core::printable(std::string{char(a), char(b)});
      const bool clean =
          std::all_of(shown.begin(), shown.end(), [](unsigned char c) { return c >= 0x20 && c != 0x7F; });
      if (!clean || core::printable(shown) != shown) FAIL("bytes " << a << " " << b << " become " << shown);
    }
  }
}

TEST_CASE("a very long name is shown by its beginning") {
  CHECK(core::quoted("a\x1b") == "'a\\x1b'");
  const std::string shown = core::quoted(std::string(4096, 'x'));
  CHECK(shown.size() < 100);
  CHECK(shown.find("4096 bytes") != std::string::npos);
  std::string accents;
  for (int i = 0; i < 200; ++i) accents += i == 0 ? "x" : "\xC3\xA4";
  CHECK(core::quoted(accents).find("\\x") == std::string::npos);  // cut between characters
}

TEST_CASE("names in a file stay in its folder") {
  const test::TemporaryFolder folder;
  fs::create_directories(folder / "set/sub");
  std::ofstream(folder / "secret.png") << "x";
  std::ofstream(folder / "set/a.png") << "x";
  fs::create_symlink("../secret.png", folder / "set/out.png");
  fs::create_symlink("a.png", folder / "set/in.png");
  fs::create_directory_symlink("..", folder / "set/up");
  fs::create_symlink("/nowhere/at/all", folder / "set/dangling.png");
  const fs::path set = folder / "set";

  for (const char* name :
       {"a.png", "sub/b.png", "./a.png", "in.png", "not_there.png", "name with blanks", "\xE4.png", "..a"}) {
    CAPTURE(name);
    CHECK(core::path_inside(set, name, "list:1") == set / name);
  }
  const auto refused = [&](const std::string& name, const std::string& why) {
    CAPTURE(name);
    const std::string said = test::failure_of<core::BadInput>([&] { core::path_inside(set, name, "list:1"); });
    CHECK(said.starts_with("list:1: "));
    CHECK(said.find(why) != std::string::npos);
    CHECK(core::printable(said) == said);
  };
  for (const char* name : {"../secret.png", "sub/../../secret.png", "sub/../a.png", "/etc/passwd", "out.png",
                           "up/secret.png", "up/set/../secret.png", "..", "dangling.png"}) {
    refused(name, "leads out of the folder");
  }
  refused("", "names no file");
  refused("a\0.png"s, "control character");
  refused("a\nb", "control character");
  refused("\x1b[2J", "control character");
  refused(std::string(4096, 'a'), "longer than");
  refused(std::string(256, 'a'), "longer than");
  refused((std::string(200, 'a') + "/") + std::string(4000, '/'), "longer than");
  // From a bare file name's folder.
  CHECK(core::path_inside("", "a.png", "list") == "a.png");
  CHECK_THROWS_AS(core::path_inside("", "../a.png", "list"), core::BadInput);
}

TEST_CASE("nesting is measured without parsing") {
  CHECK_FALSE(core::json_nests_deeper("[[[]]]", 3));
  CHECK(core::json_nests_deeper("[[[]]]", 2));
  CHECK_FALSE(core::json_nests_deeper(R"(["[[[[", "\"[[[["])", 1));
  CHECK_FALSE(core::json_nests_deeper(std::string(100'000, ']'), 500));
  CHECK(core::line_of_longer_key("a = 1\nb.c.d = 2\n", 3) == 0);
  CHECK(core::line_of_longer_key("a = 1\nb.c.d = 2\n", 2) == 2);
  CHECK(core::line_of_longer_key("[a.b.c]\n", 2) == 1);
  CHECK(core::line_of_longer_key("x = {a.b.c = 1}\n", 2) == 1);
  // No keys: numbers, texts, comments.
  CHECK(core::line_of_longer_key("v = [1.5, 2.5, 3.5, 4.5]\n# a.b.c.d\ns = \"a.b.c.d\"\nt = '''\na.b.c.d\n'''\n", 2) ==
        0);
  CHECK(core::line_of_longer_key("s = \"\\\".\" # .\nt = \"\"\"a\"b.c.d\"\"\"\n\"=.\".b.'[.'.c = 1\n", 2) == 3);
}

TEST_CASE("TOML that goes too deep is refused before it is parsed") {
  std::string deep = "a";
  for (int i = 0; i < 100'000; ++i) deep += ".a";
  for (const std::string& text : {deep + " = 1\n", "x = 1\n[" + deep + "]\n", "x = {" + deep + " = 1}\n"}) {
    const std::string said = test::failure_of<core::BadInput>([&] { core::TomlTable::parse(text, "deep.toml"); });
    CHECK(said.starts_with("deep.toml:"));
  }
  for (const char* open : {"[", "{a="}) {
    std::string text = "x = ";
    for (int i = 0; i < 50'000; ++i) text += open;
    CHECK_THROWS_AS(core::TomlTable::parse(text, "deep.toml"), core::BadInput);
  }
  CHECK_THROWS_AS(core::TomlTable::parse("a = 1\na = 2\n", "twice.toml"), core::BadInput);
  CHECK_THROWS_AS(core::TomlTable::parse("a = \"\xFF\"\n", "latin.toml"), core::BadInput);
  CHECK(core::TomlTable::parse("\xEF\xBB\xBF"
                               "a = 1\r\n",
                               "windows.toml")
            .integer("a") == 1);
  CHECK_THROWS_AS(core::TomlTable::parse("a = 1e999\n", "large.toml").number("a"), core::BadInput);
  CHECK_THROWS_AS(core::TomlTable::parse("a = nan\n", "nan.toml").number("a"), core::BadInput);
}

TEST_CASE("a child's crash, loop or hunger is the file's fault, and its result is the parent's") {
  const auto refused = [](const core::ChildLimits& limits, const std::function<std::string()>& work) {
    return test::failure_of<core::BadInput>([&] { core::in_child("mesh.ply", limits, work); });
  };
  std::string large(3 << 20, 'x');
  large[5] = '\0';
  CHECK(core::in_child("mesh.ply", {}, [&] { return large; }) == large);
  CHECK(core::in_child("mesh.ply", {}, [] { return std::string(); }).empty());
  int here = 0;
  core::in_child("mesh.ply", {}, [&] { return std::to_string(++here); });
  CHECK(here == 0);
  CHECK(refused({}, []() -> std::string { throw core::StoreError("this is wrong"); }) == "this is wrong");
  CHECK(refused({}, []() -> std::string { std::abort(); }) == "mesh.ply: is damaged: its reader crashed on it");
  CHECK(refused({}, []() -> std::string { throw 3; }) == "mesh.ply: is damaged: its reader crashed on it");
  CHECK(refused({}, []() -> std::string { throw std::bad_alloc(); }).find("memory") != std::string::npos);
  const core::ChildLimits short_time{.processor_time = std::chrono::seconds(1)};
  const std::string said = refused(short_time, [] {
    for (std::atomic<int> i = 0;; ++i) {
    }
    return std::string();
  });
  CHECK(said.find("longer than 1 s") != std::string::npos);
}
