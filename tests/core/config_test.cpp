#include "core/config.h"

#include <catch2/catch.hpp>

#include "core/error.h"
#include "core/failure.h"
#include "core/file.h"
#include "support/support.h"

using namespace lightstage;
using core::TomlTable;
using test::says;

namespace {

const char* const kText = R"(name = "stage"
radius = 1.5
count = 12
on = true
axis = [0, 1.0, -2]
words = ["a", "b"]

[camera]
width = 640
[camera.lens]
k1 = -0.1

[[step]]
light = 1
[[step]]
light = 2
)";

template <class Function>
std::string refusal(const std::string& text, const Function& function) {
  return test::failure_of<core::BadInput>([&] {
    const TomlTable table = TomlTable::parse(text, "x.toml");
    function(table);
    table.finish();
  });
}

}  // namespace

TEST_CASE("values of every type are read, and defaults only where a key is absent") {
  const TomlTable t = TomlTable::parse(kText, "x.toml");
  CHECK(t.string("name") == "stage");
  CHECK(t.string("title", "none") == "none");
  CHECK(t.number("radius") == 1.5);
  CHECK(t.number("count") == 12);
  CHECK(t.number("weight", 2.5) == 2.5);
  CHECK(t.integer("count") == 12);
  CHECK(t.integer("seed", -3) == -3);
  CHECK(t.integer("count", -3) == 12);
  CHECK(t.boolean("on", false));
  CHECK(t.boolean("off", true));
  CHECK(t.numbers("axis", 3) == std::vector<double>{0, 1, -2});
  CHECK(t.strings("words") == std::vector<std::string>{"a", "b"});
  CHECK(t.strings("letters", {"z"}) == std::vector<std::string>{"z"});
  CHECK(t.table("camera").integer("width") == 640);
  CHECK(t.table("camera").table("lens").number("k1") == -0.1);
  CHECK_FALSE(t.optional_table("projector").has_value());
  const std::vector<TomlTable> steps = t.tables("step");
  REQUIRE(steps.size() == 2);
  CHECK(steps[0].integer("light") == 1);
  CHECK(steps[1].integer("light") == 2);
  CHECK(t.tables("pass").empty());
  CHECK_NOTHROW(t.finish());
}

TEST_CASE("missing keys, wrong types and values that are not finite name file and line") {
  CHECK(says(refusal("a = 1\n", [](const TomlTable& t) { t.number("b"); }), "x.toml:1:", "'b' is missing"));
  CHECK(says(refusal("a = 1\n\n[cam]\n", [](const TomlTable& t) { t.table("cam").integer("width"); }),
             "x.toml:3:", "'cam.width' is missing"));
  CHECK(says(refusal("\na = 'x'\n", [](const TomlTable& t) { t.number("a"); }), "x.toml:2:", "'a' must be a number"));
  CHECK(says(refusal("a = 1.5\n", [](const TomlTable& t) { t.integer("a"); }), "x.toml:1:", "integer"));
  CHECK(says(refusal("a = 1.5\n", [](const TomlTable& t) { t.integer("a", 3); }), "x.toml:1:", "integer"));
  CHECK(says(refusal("a = 1\n", [](const TomlTable& t) { t.boolean("a", true); }), "x.toml:1:", "true or false"));
  CHECK(says(refusal("a = 1\n", [](const TomlTable& t) { t.string("a"); }), "x.toml:1:", "string"));
  CHECK(says(refusal("a = 1\n", [](const TomlTable& t) { t.table("a"); }), "x.toml:1:", "table"));
  CHECK(says(refusal("a = 1\n", [](const TomlTable& t) { t.tables("a"); }), "x.toml:1:", "array"));
  CHECK(says(refusal("a = [1,\n 'x']\n", [](const TomlTable& t) { t.numbers("a"); }), "x.toml:2:", "number"));
  CHECK(says(refusal("a = [1, 2]\n", [](const TomlTable& t) { t.numbers("a", 3); }), "x.toml:1:", "3 numbers, not 2"));
  CHECK(says(refusal("a = inf\n", [](const TomlTable& t) { t.number("a"); }), "x.toml:1:", "finite"));
  CHECK(says(refusal("a = [0.0, nan]\n", [](const TomlTable& t) { t.numbers("a"); }), "x.toml:1:", "finite"));
  CHECK(says(refusal("b = 1\na = -3\n", [](const TomlTable& t) { t.fail("a", "must be positive"); }),
             "x.toml:2:", "key 'a' must be positive"));
}

TEST_CASE("text that is not TOML names file and line") {
  CHECK(says(refusal("a = 1\nb = = 2\n", [](const TomlTable&) {}), "x.toml:2:"));
  CHECK(says(refusal("a = 1\na = 2\n", [](const TomlTable&) {}), "x.toml:2:"));
  CHECK(says(refusal("a = \"x\n", [](const TomlTable&) {}), "x.toml:1:"));
}

TEST_CASE("a key that nobody asked for is an error with a hint, in nested tables too") {
  const auto ask = [](const TomlTable& t) {
    t.number("radius", 1);
    for (const TomlTable& step : t.tables("step")) step.integer("light", 0);
  };
  CHECK(says(refusal("\nraduis = 2\n", ask), "x.toml:2:", "'raduis' is not known", "(did you mean 'radius'?)"));
  CHECK(says(refusal("[[step]]\nlight = 1\n[[step]]\nlihgt = 2\n", ask), "x.toml:4:", "'step[1].lihgt'", "'light'"));
  const std::string far = refusal("zebra = 2\n", ask);
  CHECK(says(far, "x.toml:1:", "'zebra'"));
  CHECK(far.find("did you mean") == std::string::npos);
  // The first in the file, not in the alphabet.
  CHECK(says(refusal("zz = 1\naa = 2\n", ask), "x.toml:1:", "'zz'"));
  // A whole table that nobody opened.
  CHECK(says(refusal("[other]\na = 1\n", ask), "x.toml:1:", "'other'"));
}

TEST_CASE("what was asked of a table counts wherever the table was taken from") {
  const TomlTable t = TomlTable::parse("[cam]\na = 1\nb = 2\n", "x.toml");
  t.table("cam").integer("a");
  t.table("cam").integer("b");
  CHECK_NOTHROW(t.finish());
}

TEST_CASE("a missing configuration file is named") {
  const std::string message = test::failure_of<core::BadInput>([] { TomlTable::read_file("/nowhere/stage.toml"); });
  CHECK(says(message, "/nowhere/stage.toml"));
  const test::TemporaryFolder folder;
  core::write_file_atomically(folder / "s.toml", "a = [\n");
  CHECK(says(test::failure_of<core::BadInput>([&] { TomlTable::read_file(folder / "s.toml"); }),
             (folder / "s.toml").string() + ":"));
}
