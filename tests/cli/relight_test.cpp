// What `relight` takes, and the pictures that it leaves.
#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <fstream>
#include <set>
#include <thread>

#include "cli/darkroom.h"
#include "cli/program.h"
#include "core/image_file.h"

using namespace lightstage;
namespace fs = std::filesystem;

namespace {

// A sky of one colour on each side with a sun, 24 x 12 pixels: a turn of 24 frames moves it by a pixel each.
void write_sky(const fs::path& path, float sun) {
  core::Image map(12, 24, 3);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 24; ++x)
      for (int c = 0; c < 3; ++c) map(y, x, c) = x < 12 ? 0.3f + 0.1f * float(c) : 0.1f;
  map(3, 9, 0) = sun;
  core::write_image(path, map);
}

class Studio : public test::Darkroom {
 public:
  Studio() {
    write_sky(*this / "sky.exr", 40);
    write_sky(*this / "dusk.exr", 4);
  }

  test::Outcome relight(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), {"relight", "ball", "--quiet", "--json"});
    return run(arguments);
  }

  nlohmann::json lit(const std::vector<std::string>& arguments) const {
    const test::Outcome outcome = relight(arguments);
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.json();
  }

  void refused(const std::vector<std::string>& arguments, int status, const std::vector<std::string>& words) const {
    const test::Outcome outcome = relight(arguments);
    CAPTURE(arguments, outcome.err);
    CHECK(outcome.status == status);
    for (const std::string& word : words) CHECK_THAT(outcome.err, Catch::Contains(word));
  }

  core::Image picture(const std::string& name) const { return core::read_image(*this / name); }
};

double largest_difference(const core::Image& a, const core::Image& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i)
    largest = std::max(largest, std::abs(double(a.values()[i]) - double(b.values()[i])));
  return largest;
}

core::Image sum(const core::Image& a, const core::Image& b) {
  core::Image both = a;
  for (std::size_t i = 0; i < both.values().size(); ++i) both.values()[i] += b.values()[i];
  return both;
}

constexpr double kHalf = 2e-3;  // half floats of values up to 2

std::set<std::string> files_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

}  // namespace

TEST_CASE("several lights on the command line add up, each with its own radius and colour or one for all") {
  const Studio studio;
  studio.lit({"--light", "40,20", "--radius", "10", "--colour", "1,0.5,0", "--light", "-60,0", "--radius", "0",
              "--colour", "0,0,1.5", "--method", "rbf", "--out", studio / "two.exr"});
  studio.lit(
      {"--light", "40,20", "--radius", "10", "--colour", "1,0.5,0", "--method", "rbf", "--out", studio / "first.exr"});
  studio.lit({"--light", "-60,0", "--colour", "0,0,1.5", "--method", "rbf", "--out", studio / "second.exr"});
  CHECK(largest_difference(studio.picture("two.exr"), sum(studio.picture("first.exr"), studio.picture("second.exr"))) <
        kHalf);
  // Where an option stands does not matter, and one serves all.
  studio.lit(
      {"--colour", "0,0,1.5", "--light", "40,20", "--light", "-60,0", "--method", "rbf", "--out", studio / "blue.exr"});
  CHECK(studio.picture("blue.exr")(10, 9, 0) == 0);
  CHECK(studio.picture("blue.exr")(10, 9, 2) > 0);

  const std::vector<std::string> two{"--light", "40,20", "--light", "0,0,1", "--out", studio / "a.exr"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), two.begin(), two.end());
    return more;
  };
  studio.refused(with({"--radius", "1", "--radius", "2", "--radius", "3"}), 2, {"--radius", "3 times", "2 lights"});
  studio.refused(with({"--colour", "1,1"}), 2, {"--colour", "'1,1'", "r,g,b"});
  studio.refused(with({"--colour", "1,-1,1"}), 2, {"--colour", "r,g,b"});
  studio.refused(with({"--turn", "3"}), 2, {"--turn", "--env"});
  studio.refused(with({"--rig", "a.toml"}), 2, {"--light", "--rig"});
  studio.refused({"--env", studio / "sky.exr", "--rig", "a.toml", "--out", studio / "a.exr"}, 2, {"--env", "--rig"});
  studio.refused({"--env", studio / "sky.exr", "--radius", "3", "--out", studio / "a.exr"}, 2, {"--radius", "--light"});
  studio.refused({"--out", studio / "a.exr"}, 2, {"--light", "--env", "--rig"});
  CHECK_FALSE(fs::exists(studio / "a.exr"));
}

TEST_CASE("rotations that return to the start are bit-equal") {
  const Studio studio;
  const auto turned = [&](const std::string& degrees) {
    studio.lit({"--env", studio / "sky.exr", "--method", "rbf", "--rotate", degrees, "--out", studio / "turned.exr"});
    return studio.picture("turned.exr");
  };
  const core::Image start = turned("0"), odd = turned("33.3");
  CHECK(turned("-720") == start);
  CHECK(turned("393.3") == odd);
  CHECK(largest_difference(start, odd) > 0.01);
}

TEST_CASE("a turn of the environment: whole frames in a folder at one exposure, gone on with and never stale") {
  const Studio studio;
  const std::vector<std::string> turn{"--env", studio / "sky.exr", "--method", "rbf",   "--turn",
                                      "4",     "--rotate",         "15",       "--out", studio / "turn/"};
  const nlohmann::json made = studio.lit(turn);
  REQUIRE(made["frames"].size() == 4);
  CHECK(made["already_made"] == 0);
  CHECK(made["method"] == "rbf");
  for (const char* key : {"scan", "directions_synthesised", "seconds", "stops", "exr", "png"})
    CHECK(made.contains(key));
  CHECK(files_in(studio / "turn") == std::set<std::string>{"sky_0000.exr", "sky_0000.png", "sky_0001.exr",
                                                           "sky_0001.png", "sky_0002.exr", "sky_0002.png",
                                                           "sky_0003.exr", "sky_0003.png"});
  for (int i = 0; i < 4; ++i) {
    const nlohmann::json& frame = made["frames"][std::size_t(i)];
    CHECK(frame["file"] == studio / ("turn/sky_000" + std::to_string(i) + ".exr"));
    CHECK(frame["stops"] == made["stops"]);
    CHECK(frame["already_made"] == false);
  }
  studio.lit({"--env", studio / "sky.exr", "--method", "rbf", "--rotate", "195", "--out", studio / "one.exr"});
  CHECK(studio.picture("one.exr") == studio.picture("turn/sky_0002.exr"));

  // Nothing to do; one to do; a PNG to do.
  const std::string whole = test::fingerprint(studio / "turn");
  CHECK(studio.lit(turn)["already_made"] == 4);
  for (const char* lost : {"turn/sky_0000.exr", "turn/sky_0003.png"}) {
    fs::remove(studio / lost);
    const nlohmann::json again = studio.lit(turn);
    CHECK(again["already_made"] == 3);
    CHECK(again["stops"] == made["stops"]);
    CHECK(test::fingerprint(studio / "turn") == whole);
  }

  // Anything else is refused, and leaves all as it is.
  const auto otherwise = [&](const std::string& option, const std::string& value) {
    std::vector<std::string> arguments = turn;
    const auto at = std::find(arguments.begin(), arguments.end(), option);
    if (at == arguments.end()) {
      arguments.insert(arguments.end(), {option, value});
    } else {
      *(at + 1) = value;
    }
    studio.refused(arguments, 2, {"sky_0000.exr", "--out", "remove"});
    CHECK(test::fingerprint(studio / "turn") == whole);
  };
  otherwise("--rotate", "16");
  otherwise("--smoothing", "0.5");
  otherwise("--exposure", "1");
  write_sky(studio / "sky.exr", 41);
  otherwise("--turn", "4");
  write_sky(studio / "sky.exr", 40);
  core::write_image(studio / "turn/sky_0001.exr", core::Image(20, 18, 3));
  studio.refused(turn, 2, {"sky_0001.exr", "changed since", "remove"});
  fs::remove(studio / "turn/sky_0001.exr");
  CHECK(studio.lit(turn)["already_made"] == 3);
  CHECK(test::fingerprint(studio / "turn") == whole);
}

TEST_CASE("a turn that is killed or interrupted leaves whole pictures, and goes on to the same end") {
  const Studio studio;
  const auto turn = [&](const std::string& out) {
    return std::vector<std::string>{"relight", "ball", "--env", studio / "sky.exr",   "--method", "rbf",
                                    "--turn",  "100",  "--out", studio / (out + "/"), "--quiet",  "--json"};
  };
  const auto begin_until = [&](const std::string& last, int signal) {
    test::BackgroundRun run(studio.store(), turn("broken"));
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!fs::exists(studio / ("broken/" + last)) && std::chrono::steady_clock::now() < deadline)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    run.signal(signal);
    return run.wait();
  };
  REQUIRE(begin_until("sky_0003.exr", SIGKILL) == 128 + SIGKILL);
  REQUIRE(begin_until("sky_0011.exr", SIGINT) == 130);
  for (const std::string& name : files_in(studio / "broken"))
    if (name.ends_with(".exr") && !name.starts_with(".")) CHECK(studio.picture("broken/" + name).height() == 20);
  const test::Outcome rest = studio.run(turn("broken"));
  INFO(rest.err);
  REQUIRE(rest.status == 0);
  CHECK(rest.json()["already_made"].get<int>() >= 12);
  REQUIRE(studio.run(turn("whole")).status == 0);
  for (const char* frame : {"sky_0000", "sky_0007", "sky_0050", "sky_0099"})
    for (const std::string end : {".exr", ".png"})
      CHECK(studio.picture("broken/" + (frame + end)) == studio.picture("whole/" + (frame + end)));
}

TEST_CASE("several environments in one run, each at its own exposure") {
  const Studio studio;
  const std::vector<std::string> both{"--env",    studio / "sky.exr", "--env", studio / "dusk.exr",
                                      "--method", "linear",           "--out", studio / "both"};
  const nlohmann::json made = studio.lit(both);
  CHECK(files_in(studio / "both") == std::set<std::string>{"dusk.exr", "dusk.png", "sky.exr", "sky.png"});
  CHECK(made["frames"][0]["stops"] != made["frames"][1]["stops"]);
  studio.lit({"--env", studio / "dusk.exr", "--method", "linear", "--out", studio / "dusk_alone.exr"});
  CHECK(studio.picture("both/dusk.exr") == studio.picture("dusk_alone.exr"));
  // One of them alone in the same folder is there already.
  const nlohmann::json again =
      studio.lit({"--env", studio / "dusk.exr", "--method", "linear", "--out", studio / "both/"});
  CHECK(again["already_made"] == 1);
  CHECK(again["exr"] == studio / "both/dusk.exr");

  studio.refused({"--env", studio / "sky.exr", "--env", studio / "sky.exr", "--out", studio / "x/"}, 2, {"'sky'"});
  studio.refused({"--env", studio / "sky.exr", "--env", studio / "none.exr", "--out", studio / "x/"}, 3, {"none.exr"});
  studio.refused({"--env", studio / "sky.exr", "--turn", "2", "--out", studio / "x.exr"}, 2, {"2 pictures", "x/"});
  studio.refused({"--env", studio / "sky.exr", "--out", studio / "x"}, 2, {".exr", "/"});
  studio.refused({"--env", studio / "sky.exr", "--out", studio / "sky.exr"}, 2, {"the environment itself"});
  studio.refused({"--env", studio / "sky.exr", "--method", "linear", "--out", studio / ""}, 2, {"sky.exr", "--out"});
  CHECK_FALSE(fs::exists(studio / "x"));
}

TEST_CASE("pictures that others made are never written over, nor are maps that are PNGs") {
  const Studio studio;
  core::write_image(studio / "map.png", core::Image(4, 8, 3));
  fs::create_directory(studio / "mine");
  fs::copy_file(studio / "map.png", studio / "mine/sky.png");
  const std::string mine = test::fingerprint(studio / "mine");
  studio.refused({"--env", studio / "map.png", "--method", "linear", "--out", studio / "map.exr"}, 2,
                 {"map.png", "the environment itself"});
  studio.refused({"--env", studio / "map.png", "--method", "linear", "--out", studio / ""}, 2, {"map.png", "remove"});
  studio.refused({"--env", studio / "sky.exr", "--method", "linear", "--out", studio / "mine/"}, 2,
                 {"sky.png", "remove"});
  CHECK(core::read_image(studio / "map.png").size() == core::ImageSize{4, 8, 3});
  CHECK(test::fingerprint(studio / "mine") == mine);
  CHECK_FALSE(fs::exists(studio / "map.exr"));
}

TEST_CASE("light that a picture cannot hold is refused or said") {
  const Studio studio;
  const auto under = [&](float radiance) {
    core::Image map(4, 8, 3);
    std::fill(map.values().begin(), map.values().end(), radiance);
    core::write_image(studio / "even.hdr", map);
    return studio.run({"relight", "ball", "--env", studio / "even.hdr", "--method", "linear", "--out",
                       studio / "even.exr", "--json"});
  };
  CHECK(under(1).err.empty());
  CHECK_THAT(under(1e6F).err, Catch::Contains("even.exr") && Catch::Contains("65504"));
  CHECK_THAT(under(1e-6F).err, Catch::Contains("digits are lost"));
  std::ofstream(studio / "bright.toml") << "[environment]\nfile = \"even.hdr\"\nexposure_ev = 60\n";
  under(1e30F);
  studio.refused(
      {"--rig", studio / "bright.toml", "--method", "linear", "--exposure", "0", "--out", studio / "bright.exr"}, 3,
      {"bright.exr", "too bright"});
  CHECK_FALSE(fs::exists(studio / "bright.png"));
}

TEST_CASE("a rig with a moving light and an environment is the sum of what each gives") {
  const Studio studio;
  std::ofstream(studio / "moving.toml") << R"(
fps = 2
[[light]]
direction = [40, 20]
radius_deg = 5
[[light]]
colour = [0, 1, 0]
intensity = 0.5
[[light.key]]
time_s = 0
direction = [-60, 0]
[[light.key]]
time_s = 1
direction = [60, 0]
[environment]
file = "sky.exr"
exposure_ev = -1
)";
  const std::vector<std::string> rig{"--rig", studio / "moving.toml", "--method",   "rbf",
                                     "--out", studio / "frames/",     "--exposure", "0"};
  const nlohmann::json made = studio.lit(rig);
  REQUIRE(made["frames"].size() == 3);
  CHECK(made["stops"] == 0);
  studio.lit(
      {"--light", "40,20", "--radius", "5", "--method", "rbf", "--domain", "linear", "--out", studio / "key.exr"});
  studio.lit({"--env", studio / "sky.exr", "--method", "rbf", "--out", studio / "sky_lit.exr"});
  core::Image sky = studio.picture("sky_lit.exr");
  for (float& v : sky.values()) v /= 2;
  const core::Image still = sum(studio.picture("key.exr"), sky);
  int frame = 0;
  for (const char* light : {"-60,0", "0,0", "60,0"}) {
    studio.lit({"--light", light, "--colour", "0,0.5,0", "--method", "rbf", "--domain", "linear", "--out",
                studio / "moving.exr"});
    CHECK(largest_difference(studio.picture("frames/moving_000" + std::to_string(frame++) + ".exr"),
                             sum(still, studio.picture("moving.exr"))) < kHalf);
  }
  // A frame made alone is the frame made with the others.
  const std::string whole = test::fingerprint(studio / "frames");
  fs::remove(studio / "frames/moving_0001.exr");
  CHECK(studio.lit(rig)["already_made"] == 2);
  CHECK(test::fingerprint(studio / "frames") == whole);

  std::ofstream(studio / "bad.toml") << "[[light]]\ndirection = [0, 0, 0]\n";
  studio.refused({"--rig", studio / "bad.toml", "--out", studio / "y/"}, 3, {"bad.toml:2", "direction"});
  std::ofstream(studio / "lost.toml") << "[environment]\nfile = 'lost.hdr'\n";
  studio.refused({"--rig", studio / "lost.toml", "--out", studio / "y/"}, 3, {"lost.hdr"});
}
