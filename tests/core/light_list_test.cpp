#include "core/light_list.h"

#include <catch2/catch.hpp>
#include <fstream>
#include <limits>

#include "core/error.h"
#include "core/failure.h"
#include "core/file.h"
#include "core/sphere.h"
#include "support/support.h"

using namespace lightstage;

namespace {

std::string refusal(const std::string& text) {
  const test::TemporaryFolder folder;
  core::write_file_atomically(folder / "dirs.lp", text);
  return test::failure_of<core::BadInput>([&] { core::read_lp(folder / "dirs.lp"); });
}

}  // namespace

TEST_CASE(".lp files are read with spaces in names, CRLF, tabs and trailing blank lines") {
  const test::TemporaryFolder folder;
  core::write_file_atomically(
      folder / "dirs.lp",
      "\xEF\xBB\xBF 3 \r\njpg/my photo 01.jpg 0 0 2\r\nb\t-1.0\t0\t+0\r\n  c.png 0 1e-9 0\r\n\r\n \n");
  const std::vector<core::LpEntry> entries = core::read_lp(folder / "dirs.lp");
  REQUIRE(entries.size() == 3);
  CHECK(entries[0].name == "jpg/my photo 01.jpg");
  CHECK(entries[0].direction.vec() == core::Vec3{0, 0, 1});
  CHECK(entries[1].name == "b");
  CHECK(entries[1].direction.x() == -1);
  CHECK(entries[2].name == "c.png");
  CHECK(entries[2].direction.y() == 1);
}

TEST_CASE("bad .lp files are refused with file and line") {
  using test::says;
  CHECK(says(refusal(""), "dirs.lp:1:", "empty"));
  CHECK(says(refusal("lights\na 0 0 1\n"), "dirs.lp:1:", "'lights'"));
  CHECK(says(refusal("-1\n"), "dirs.lp:1:", "number of lights"));
  CHECK(says(refusal("0\n"), "dirs.lp:1:"));
  CHECK(says(refusal("\n2\na 0 0 1\n"), "dirs.lp:2:", "says 2 lights, but 1 follow"));
  CHECK(says(refusal("1\na 0 0 1\nb 0 0 1\n"), "dirs.lp:1:", "says 1 lights, but 2 follow"));
  CHECK(says(refusal("99999999999\na 0 0 1\n"), "dirs.lp:1:", "but 1 follow"));
  CHECK(says(refusal("2\na 0 0 1\nb 0 0 0\n"), "dirs.lp:3:", "no length"));
  CHECK(says(refusal("2\na 0 0 1\n\nb 0 nan 1\n"), "dirs.lp:4:", "not finite"));
  CHECK(says(refusal("1\na 0 inf 1\n"), "dirs.lp:2:", "not finite"));
  CHECK(says(refusal("1\na 0 1\n"), "dirs.lp:2:", "expected 'name x y z'"));
  CHECK(says(refusal("1\n0 0 1\n"), "dirs.lp:2:", "expected 'name x y z'"));
  CHECK(says(refusal("1\na b c\n"), "dirs.lp:2:"));
  CHECK(says(refusal("1\na 0 0,5 1\n"), "dirs.lp:2:", "'0,5' is not a number"));
  CHECK(says(test::failure_of<core::BadInput>([] { core::read_lp("/nowhere/dirs.lp"); }), "/nowhere/dirs.lp"));
}

TEST_CASE("a written .lp file reads back to nine digits") {
  const test::TemporaryFolder folder;
  std::vector<core::LpEntry> entries;
  for (const core::Direction& d : core::random_directions(50, 11))
    entries.push_back({"light " + std::to_string(entries.size()), d});
  core::write_lp(folder / "out.lp", entries);
  const std::vector<core::LpEntry> back = core::read_lp(folder / "out.lp");
  REQUIRE(back.size() == entries.size());
  for (std::size_t i = 0; i < back.size(); ++i) {
    CHECK(back[i].name == entries[i].name);
    CHECK(core::angle_radians(back[i].direction, entries[i].direction) < 1e-9);
  }
  CHECK_THROWS_AS(core::write_lp(folder / "none.lp", {}), core::BadInput);
  for (const char* name : {"", " a", "a ", "a\nb"})
    CHECK_THROWS_AS(core::write_lp(folder / "none.lp", {{name, core::Direction()}}), core::BadInput);
  CHECK_FALSE(std::filesystem::exists(folder / "none.lp"));
}

TEST_CASE("the light list of a real stage is read") {
  const std::filesystem::path path = test::real_data("stages/lightstage_331.lp");
  if (path.empty()) SKIP_TEST("real stage layout not found");
  const std::vector<core::LpEntry> entries = core::read_lp(path);
  CHECK(entries.size() == 331);
  CHECK(entries.front().name == "light_000");
  CHECK(entries.front().direction.y() == Approx(0.158130).margin(1e-6));
}
