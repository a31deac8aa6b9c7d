// Each kind of bad input: one line that names file and place, the right exit status, and the store as it was.
#include <OpenImageIO/imageio.h>

#include <catch2/catch.hpp>
#include <fstream>

#include "cli/program.h"
#include "core/image_file.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;
namespace fs = std::filesystem;

namespace {

// Six small pictures with directions, as RTI lays them out.
class Workshop {
 public:
  Workshop() {
    REQUIRE(run_program(store(), {"init"}).status == 0);
    for (int i = 0; i < 6; ++i) {
      core::Image picture(8, 6, 3);
      for (float& value : picture.values()) value = 0.1f * float(i + 1);
      core::write_image(folder_ / ("p" + std::to_string(i) + ".exr"), picture);
    }
    write_list(6, "0 0 1");
  }

  void write_list(int count, const std::string& last_direction, const std::string& last_name = "p5.exr") const {
    std::ofstream list(folder_ / "dirs.lp");
    list << count << "\np0.exr 1 0 1\np1.exr -1 0 1\np2.exr 0 1 1\np3.exr 0 -1 1\np4.exr 1 1 1\n"
         << last_name << " " << last_direction << "\n";
  }

  fs::path store() const { return folder_ / "store"; }
  fs::path operator/(const std::string& name) const { return folder_ / name; }

  test::Outcome import() const {
    return run_program(store(), {"import", "lp", (folder_ / "dirs.lp").string(), "--name", "set", "--quiet"});
  }

  void check_refused(const test::Outcome& outcome, int status, std::vector<std::string> said) const {
    INFO(outcome.err);
    CHECK(outcome.status == status);
    CHECK(outcome.out.empty());
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    for (const std::string& text : said) CHECK(outcome.err.find(text) != std::string::npos);
  }

 private:
  test::TemporaryFolder folder_;
};

}  // namespace

TEST_CASE("pictures that are sound are imported") {
  const Workshop workshop;
  const test::Outcome outcome = workshop.import();
  INFO(outcome.err);
  CHECK(outcome.status == 0);
}

TEST_CASE("bad input to import is refused and the store stays as it was") {
  const Workshop workshop;
  const std::string before = test::fingerprint(workshop.store());

  SECTION("a missing list") {
    fs::remove(workshop / "dirs.lp");
    workshop.check_refused(workshop.import(), 3, {"dirs.lp"});
  }
  SECTION("a picture that the list names and that is not there") {
    fs::remove(workshop / "p3.exr");
    workshop.check_refused(workshop.import(), 3, {"dirs.lp", "light 4 of 6", "p3.exr"});
  }
  SECTION("more lights than pictures") {
    workshop.write_list(7, "0 0 1");
    workshop.check_refused(workshop.import(), 3, {"dirs.lp", "7", "6"});
  }
  SECTION("a truncated EXR") {
    fs::resize_file(workshop / "p2.exr", fs::file_size(workshop / "p2.exr") / 2);
    workshop.check_refused(workshop.import(), 3, {"p2.exr"});
  }
  SECTION("an infinite pixel") {
    core::Image picture(8, 6, 3);
    picture(5, 4, 1) = INFINITY;
    // Our own writer refuses such pixels, other programs do not.
    const std::string file = (workshop / "p1.exr").string();
    const auto output = OIIO::ImageOutput::create(file);
    REQUIRE(output->open(file, OIIO::ImageSpec(6, 8, 3, OIIO::TypeDesc::HALF)));
    REQUIRE(output->write_image(OIIO::TypeDesc::FLOAT, picture.values().data()));
    REQUIRE(output->close());
    const test::Outcome outcome = workshop.import();
    workshop.check_refused(outcome, 3, {"p1.exr", "4", "5"});
  }
  SECTION("a zero direction") {
    workshop.write_list(6, "0 0 0");
    workshop.check_refused(workshop.import(), 3, {"dirs.lp:7"});
  }
  SECTION("a direction that is no number") {
    workshop.write_list(6, "0 nan 1");
    workshop.check_refused(workshop.import(), 3, {"dirs.lp:7"});
  }
  SECTION("a picture of another size") {
    core::write_image(workshop / "p4.exr", core::Image(8, 7, 3));
    workshop.check_refused(workshop.import(), 3, {"p4.exr", "7x8", "6x8"});
  }
  SECTION("a path that leaves the folder") {
    workshop.write_list(6, "0 0 1", "../secret.exr");
    workshop.check_refused(workshop.import(), 3, {"dirs.lp", "light 6 of 6", "../secret.exr"});
  }
  CHECK(test::fingerprint(workshop.store()) == before);
}

TEST_CASE("a store of a newer version is refused and left as it is") {
  const Workshop workshop;
  // Bytes 60 to 63 of a SQLite file are user_version, big-endian.
  std::fstream file(workshop.store() / "store.sqlite", std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(60);
  file.write("\0\0\0\x63", 4);
  file.close();
  const std::string before = test::fingerprint(workshop.store());
  workshop.check_refused(workshop.import(), 5, {"store", "99"});
  workshop.check_refused(run_program(workshop.store(), {"store", "verify"}), 5, {"99"});
  CHECK(test::fingerprint(workshop.store()) == before);
}

TEST_CASE("bad input to the other commands names file, place and remedy") {
  const Workshop workshop;
  REQUIRE(workshop.import().status == 0);
  const std::string before = test::fingerprint(workshop.store());
  const auto run = [&](std::vector<std::string> arguments) {
    return run_program(workshop.store(), std::move(arguments));
  };
  const std::string out = (workshop / "out.exr").string();

  workshop.check_refused(run({"relight", "sett", "--light", "0,0,1", "--out", out}), 2, {"'sett'", "'set'"});
  workshop.check_refused(run({"relight", "set", "--light", "0,0,0", "--out", out}), 2, {"--light", "0,0,0"});
  workshop.check_refused(run({"relight", "set", "--light", "north", "--out", out}), 2, {"--light", "north"});
  workshop.check_refused(run({"relight", "set", "--env", (workshop / "none.hdr").string(), "--out", out}), 3,
                         {"none.hdr"});
  workshop.check_refused(run({"relight", "set", "--light", "0,0,1", "--method", "liner", "--out", out}), 2,
                         {"liner", "linear"});
  workshop.check_refused(run({"relight", "set", "--light", "0,0,1", "--out", (workshop / "out.png").string()}), 2,
                         {".exr"});
  workshop.check_refused(run({"relight", "set", "--light", "0,0,1", "--method", "superres", "--out", out}), 2,
                         {"train"});
  workshop.check_refused(run({"relight", "set", "--light", "0,0,1", "--env", "a.hdr", "--out", out}), 2,
                         {"--light", "--env"});
  workshop.check_refused(run({"relight", "set", "--light", "0,0,1", "--radius", "nan", "--out", out}), 2,
                         {"--radius", "nan"});
  workshop.check_refused(run({"relight", "set", "--light", "0,0,1", "--exposure", "1e6", "--out", out}), 2,
                         {"--exposure"});
  workshop.check_refused(run({"superres", "set", "--lights", "10", "--method", "nearest", "--out", "a\nb"}), 2,
                         {"a\\nb"});
  workshop.check_refused(run({"align", "set"}), 2, {"set", "tracking"});
  workshop.check_refused(run({"evaluate", "set", "--off-grid"}), 2, {"set"});
  workshop.check_refused(run({"evaluate", "set"}), 2, {"--held-out"});
  workshop.check_refused(run({"train", "set", "--steps", "1", "--out", (workshop / "m.safetensors").string()}), 2,
                         {"6", "lights"});
  workshop.check_refused(
      run({"capture", "--sim", "--procedural", "1", "--stage", (workshop / "no.toml").string(), "--name", "x"}), 3,
      {"no.toml"});

  std::ofstream(workshop / "stage.toml") << "name = \"s\"\nradius_m = \"far\"\n";
  workshop.check_refused(
      run({"capture", "--sim", "--procedural", "1", "--stage", (workshop / "stage.toml").string(), "--name", "x"}), 3,
      {"stage.toml:2", "radius_m"});
  std::ofstream(workshop / "weights.safetensors") << "not a model";
  workshop.check_refused(run({"relight", "set", "--light", "0,0,1", "--method", "superres", "--model",
                              (workshop / "weights.safetensors").string(), "--out", out}),
                         3, {"weights.safetensors"});
  CHECK_FALSE(fs::exists(out));
  CHECK(test::fingerprint(workshop.store()) == before);
}
