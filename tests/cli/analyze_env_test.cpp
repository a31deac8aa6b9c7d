// An environment judged from the command line.
#include <OpenImageIO/imageio.h>

#include <catch2/catch.hpp>
#include <fstream>
#include <numeric>

#include "cli/program.h"
#include "core/file.h"
#include "core/image_file.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;

TEST_CASE("analyze-env tells a sky with a sun from one without, in JSON and in words") {
  const test::TemporaryFolder folder;
  const std::string sky = (folder / "sky.exr").string();
  const auto make_sky = [&](const std::string& sun_to_sky) {
    REQUIRE(run_program(folder / "store", {"sky", "--sun-to-sky", sun_to_sky, "--out", sky}).status == 0);
  };
  const auto analysed = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {"analyze-env", sky});
    const test::Outcome outcome = run_program(folder / "store", more);
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome;
  };
  make_sky("4");
  const nlohmann::json sunny = analysed({"--json"}).json();
  CHECK(sunny.at("verdict") == "super_resolution");
  CHECK(sunny.at("degree_90") >= 20);
  CHECK(sunny.at("width") == 256);
  CHECK(sunny.at("share_above_50") > 0.5);
  CHECK(sunny.at("small_source_share") > 0.3);
  CHECK(sunny.at("brightest_source").at("longitude") == Approx(50).margin(1));
  CHECK(sunny.at("brightest_source").at("latitude") == Approx(35).margin(1));
  CHECK(sunny.at("brightest_source").at("diameter_deg") < 3);
  const auto energy = sunny.at("energy_by_degree").get<std::vector<double>>();
  REQUIRE(energy.size() == 51);
  double held = 0;
  for (int l = 0; l <= sunny.at("degree_90").get<int>(); ++l) held += energy[std::size_t(l)];
  CHECK(held >= 0.9 * std::accumulate(energy.begin(), energy.end(), 0.0));

  const std::string words = analysed({}).out;
  CHECK(words.find("super_resolution: synthesised lights pay") != std::string::npos);
  CHECK(words.find("light in small sources: ") != std::string::npos);
  CHECK(words.find("longitude 49.9") != std::string::npos);

  make_sky("0");
  const nlohmann::json clear = analysed({"--json"}).json();
  CHECK(clear.at("verdict") == "linear");
  CHECK(clear.at("brightest_source").is_null());
  CHECK_FALSE(clear.contains("plot"));
  CHECK_FALSE(std::filesystem::exists(folder / "store"));
}

TEST_CASE("analyze-env draws the spectrum") {
  const test::TemporaryFolder folder;
  const std::string file = (folder / "<map>.exr").string(), plot = (folder / "plot.svg").string();
  for (const bool lit : {true, false}) {
    core::Image map(16, 32, 3);
    if (lit) map(4, 9, 1) = 3;
    core::write_image(file, map);
    const test::Outcome outcome = run_program(folder / "store", {"analyze-env", file, "--plot", plot, "--json"});
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    CHECK(outcome.json().at("plot") == plot);
    const std::string svg = core::read_text_file(plot);
    CHECK(svg.find("<svg ") == 0);
    CHECK(svg.rfind("</svg>\n") == svg.size() - 7);
    CHECK(svg.find("&lt;map&gt;.exr") != std::string::npos);
    CHECK((svg.find("<title>degree 50: 100.0 %</title>") != std::string::npos) == lit);
    CHECK((svg.find("no values") != std::string::npos) == !lit);
    CHECK(svg.find("nan") == std::string::npos);
  }
}

TEST_CASE("analyze-env refuses what is no environment, with the pixel where there is one") {
  const test::TemporaryFolder folder;
  const auto refused = [&](std::vector<std::string> arguments, int status, const std::string& said) {
    arguments.insert(arguments.begin(), "analyze-env");
    const test::Outcome outcome = run_program(folder / "store", arguments);
    INFO(outcome.err);
    CHECK(outcome.status == status);
    CHECK(outcome.out.empty());
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    CHECK(outcome.err.find(said) != std::string::npos);
  };
  core::Image map(8, 16, 3);
  const std::string file = (folder / "map.exr").string();
  core::write_image(file, map);
  refused({file, "--plot", (folder / "plot.png").string()}, 2, "must end in .svg");
  refused({file, "--plot", (folder / "no/plot.svg").string()}, 3, "plot.svg");
  refused({(folder / "absent.hdr").string()}, 3, "absent.hdr");
  refused({}, 2, "FILE");
  map(2, 5, 1) = NAN;
  const auto broken = OIIO::ImageOutput::create((folder / "nan.exr").string());
  REQUIRE(broken->open((folder / "nan.exr").string(), OIIO::ImageSpec(16, 8, 3, OIIO::TypeDesc::FLOAT)));
  REQUIRE(broken->write_image(OIIO::TypeDesc::FLOAT, map.pixel(0, 0)));
  broken->close();
  refused({(folder / "nan.exr").string()}, 3, "nan.exr: pixel x 5, y 2, channel 1 is nan");
  std::ofstream(folder / "text.exr") << "no picture";
  refused({(folder / "text.exr").string()}, 3, "text.exr");

  map(2, 5, 1) = -1;
  core::write_image(file, map);
  const test::Outcome negative = run_program(folder / "store", {"analyze-env", file});
  CHECK(negative.status == 0);
  CHECK(negative.err.find("1 negative values count as 0") != std::string::npos);
}

TEST_CASE("the sky that is written holds all of its sun, which is brighter than half floats go") {
  const test::TemporaryFolder folder;
  const std::string sky = (folder / "sky.exr").string();
  REQUIRE(run_program(folder / "store", {"sky", "--height", "512", "--out", sky}).status == 0);
  const core::Image map = core::read_image(sky);
  CHECK(*std::max_element(map.values().begin(), map.values().end()) > 1e5f);
}
