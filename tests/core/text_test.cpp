#include "core/text.h"

#include <catch2/catch.hpp>
#include <cmath>

using namespace lightstage;

TEST_CASE("numbers are parsed whole or not at all") {
  CHECK(core::parse_number("-1.5e3") == -1500.0);
  CHECK(core::parse_number("+2") == 2.0);
  CHECK(std::isnan(core::parse_number("nan").value()));
  for (const char* text : {"", "+", "+-1", "1 ", " 1", "1,5", "0x10", "1e999", "--1"}) {
    INFO(text);
    CHECK_FALSE(core::parse_number(text).has_value());
  }
  CHECK(core::parse_integer("-9223372036854775808") == std::numeric_limits<std::int64_t>::min());
  CHECK_FALSE(core::parse_integer("9223372036854775808").has_value());
  CHECK_FALSE(core::parse_integer("1.0").has_value());
}

TEST_CASE("text is trimmed and split") {
  CHECK(core::trim(" \t a b\r\n") == "a b");
  CHECK(core::trim(" \n").empty());
  CHECK(core::split("a,,b,", ',') == std::vector<std::string_view>{"a", "", "b", ""});
  CHECK(core::split("", ',') == std::vector<std::string_view>{""});
}

TEST_CASE("numbers are written with as many digits as asked for") {
  CHECK(core::number_text(1.0 / 3, 3) == "0.333");
  CHECK(core::number_text(-2) == "-2");
  CHECK(core::number_text(1e-300) == "1e-300");
  CHECK(core::number_text(std::nan("")) == "nan");
}

TEST_CASE("things are counted in the singular and the plural") {
  CHECK(core::counted(1, "frame") == "1 frame");
  CHECK(core::counted(0, "frame") == "0 frames");
  CHECK(core::counted(1, "object belongs", "objects belong") == "1 object belongs");
  CHECK(core::counted(3, "object belongs", "objects belong") == "3 objects belong");
}

TEST_CASE("the nearest name is found, and none when none is near") {
  const std::vector<std::string> names{"relight", "evaluate", "train", "trial"};
  CHECK(core::nearest_name("relihgt", names) == "relight");
  CHECK(core::nearest_name("trian", names) == "train");  // one swap; trial is one substitution further
  CHECK(core::nearest_name("evalute", names) == "evaluate");
  CHECK(core::nearest_name("zebra", names) == std::nullopt);
  CHECK(core::nearest_name("x", {}) == std::nullopt);
  CHECK(core::nearest_name(std::string(1000, 'x'), names) == std::nullopt);
  CHECK(core::did_you_mean("trian", names) == " (did you mean 'train'?)");
  CHECK(core::did_you_mean("zebra", names).empty());
}
