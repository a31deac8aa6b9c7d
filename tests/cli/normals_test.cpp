// Normal and albedo maps as files.
#include <catch2/catch.hpp>

#include "cli/darkroom.h"
#include "cli/program.h"

using namespace lightstage;
namespace fs = std::filesystem;

TEST_CASE("normals writes maps with a PNG beside each, enters them in the store, and says so in JSON") {
  const test::Darkroom darkroom;
  const fs::path out = darkroom / "maps" + "/of/ball";
  const test::Outcome outcome = darkroom.run({"normals", "ball", "--out", out.string(), "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  CHECK(outcome.json().at("scan") == "ball");
  CHECK(outcome.json().at("lights") == 24);
  CHECK(outcome.json().at("median_confidence") > 0.2);
  for (const char* name : {"normals", "albedo", "confidence"}) {
    CHECK(fs::exists(out / (std::string(name) + ".exr")));
    CHECK(fs::exists(out / (std::string(name) + ".png")));
  }
  // The darkroom's ball: a slope of (x - 9) / 10 to the right, (10 - y) / 11 up and 0.6 towards the camera.
  const core::Image normals = core::read_image(out / "normals.exr");
  const core::Image shown = core::read_image(out / "normals.png", {.encoding = core::Encoding::kLinear});
  const double x = (13 - 9) / 10.0, y = (10 - 5) / 11.0, length = std::sqrt(x * x + y * y + 0.36);
  CHECK(normals(5, 13, 0) == Approx(x / length).margin(0.01));
  CHECK(normals(5, 13, 1) == Approx(y / length).margin(0.01));
  CHECK(normals(5, 13, 2) == Approx(0.6 / length).margin(0.01));
  CHECK(shown(5, 13, 1) == Approx((y / length + 1) / 2).margin(0.01));
  const core::Image albedo = core::read_image(out / "albedo.exr");
  for (int c = 0; c < 3; ++c) CHECK(albedo(5, 13, c) == Approx(length * (1 - 0.2 * c)).epsilon(0.02));

  const auto products = darkroom.run({"store", "show", "ball", "--json"}).json().at("products");
  CHECK(products.dump().find("\"normals\"") != std::string::npos);
}

TEST_CASE("normals refuses a folder that cannot be made, and a scan that does not exist") {
  const test::Darkroom darkroom;
  std::ofstream(darkroom / "a file") << "text";
  const test::Outcome blocked = darkroom.run({"normals", "ball", "--out", (darkroom / "a file") + "/maps"});
  CHECK(blocked.status == 2);
  CHECK(blocked.err.find("--out") != std::string::npos);
  CHECK(darkroom.run({"normals", "bal", "--out", darkroom / "maps"}).status != 0);
}
