#include <OpenImageIO/imageio.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <map>

#include "core/error.h"
#include "core/image_file.h"
#include "core/light_list.h"
#include "core/sphere.h"
#include "db/importers.h"
#include "db/scan_loader.h"
#include "db/scene.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using Catch::Matchers::Equals;
using test::message_of;
using test::write_text;
namespace fs = std::filesystem;

namespace {

// A small set on disk in every layout, and a store that bad input must leave as it is.
struct Fixture {
  test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  fs::path set = folder / "set";
  std::vector<core::Direction> lights = test::front_lights(20);

  Fixture() { fs::create_directory(set); }

  static std::string name(std::size_t i, const std::string& extension = ".png") {
    std::string text = "p";
    return text.append(std::to_string(i)).append(extension);
  }

  void write_pictures(const std::string& extension = ".png", std::size_t count = 4) const {
    for (std::size_t i = 0; i < count; ++i) {
      core::write_image(set / name(i, extension), test::lit_ball(lights[i], 24, 20));
    }
  }
  std::string lp_text(std::size_t count = 4, const std::string& extension = ".png") const {
    std::string text = std::to_string(count) + "\n";
    for (std::size_t i = 0; i < count; ++i) {
      text += name(i, extension) + " " + std::to_string(lights[i].x()) + " " + std::to_string(lights[i].y()) + " " +
              std::to_string(lights[i].z()) + "\n";
    }
    return text;
  }
  void write_diligent(std::size_t count = 4) const {
    write_pictures(".png", count);
    std::string names, directions, intensities;
    for (std::size_t i = 0; i < count; ++i) {
      names += name(i) + "\n";
      directions += std::to_string(lights[i].x()) + "\t" + std::to_string(lights[i].y()) + " " +
                    std::to_string(lights[i].z()) + "\r\n";
      intensities += "1 2 " + std::to_string(i + 1) + "\n";
    }
    write_text(set / "filenames.txt", names);
    write_text(set / "light_directions.txt", directions);
    write_text(set / "light_intensities.txt", intensities);
  }

  // The error of an import that must fail, after checking that the store and its files are as before.
  template <class Read>
  std::string refusal(const Read& read) {
    const auto before = test::snapshot(store.folder() / "objects");
    CHECK_THROWS_AS(db::import_pictures(store, read(), "new"), core::BadInput);
    const std::string message = message_of([&] { db::import_pictures(store, read(), "new"); });
    CHECK(store.scans().empty());
    CHECK(store.products("calibration").empty());
    CHECK(test::snapshot(store.folder() / "objects") == before);
    return message;
  }
  std::string lp_refusal() {
    return refusal([&] { return db::read_lp_set(set / "a.lp"); });
  }
  std::string diligent_refusal() {
    return refusal([&] { return db::read_diligent_set(set); });
  }
  std::string csv_refusal(const std::string& text) {
    write_text(set / "lights.csv", text);
    return refusal([&] { return db::read_csv_set(set); });
  }
};

}  // namespace

TEST_CASE_METHOD(Fixture, "an .lp set becomes a scan with its calibration") {
  write_pictures();
  write_text(set / "a.lp", lp_text());
  core::Image mask(24, 20, 1);
  mask(3, 4) = 1;
  core::write_image(set / "mask.png", mask);
  const db::ImportReport report = db::import_pictures(store, db::read_lp_set(set / "a.lp"), "lion");
  CHECK(report.pictures == 4);
  CHECK(report.size == core::ImageSize{24, 20, 3});
  CHECK(report.excluded.empty());
  const db::Scan scan = store.scan("lion");
  CHECK(scan.id == report.scan_id);
  CHECK(scan.kind == db::ScanKind::kImported);
  CHECK(scan.stage_key == "scan:lion");
  CHECK(scan.steps.size() == 4);
  CHECK_THAT(scan.provenance, Contains("p3.png") && Contains("\"format\":\"lp\"") && Contains("xxh3_128"));
  const db::LoadedScan loaded = db::load_scan(store, "lion");
  REQUIRE(loaded.scan.light_count() == 4);
  CHECK(loaded.scan.masked_pixel_count() == 1);
  CHECK(loaded.scan.mask() == mask);
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(core::angle_radians(loaded.scan.light(i).direction, lights[i]) < 1e-5);
    // 8 bits sRGB, then half: a code step of sRGB is at most 0.009.
    const core::Image expected = test::lit_ball(lights[i], 24, 20);
    for (std::size_t p = 0; p < expected.values().size(); ++p) {
      CHECK(std::abs(loaded.scan.image(i)->values()[p] - expected.values()[p]) < 0.005F);
    }
  }
  CHECK(store.verify().errors == std::vector<std::string>());
  CHECK_THROWS_AS(db::import_pictures(store, db::read_lp_set(set / "a.lp"), "lion"), core::UsageError);
  CHECK_THROWS_AS(db::import_pictures(store, db::read_lp_set(set / "a.lp"), "a/b"), core::UsageError);
  CHECK(store.scans().size() == 1);
}

TEST_CASE_METHOD(Fixture, "pictures that are linear are taken so when told") {
  write_pictures(".png", 1);
  write_text(set / "a.lp", lp_text(1));
  const float encoded = core::read_image(set / "p0.png", {.encoding = core::Encoding::kLinear})(12, 10);
  db::import_pictures(store, db::read_lp_set(set / "a.lp"), "raw", core::Encoding::kLinear);
  CHECK((*db::load_scan(store, "raw").scan.image(0))(12, 10) == Approx(encoded).epsilon(1e-3));
}

TEST_CASE_METHOD(Fixture, "a scan goes out as .lp and comes in again") {
  write_diligent();
  core::Image mask(24, 20, 1);
  for (int y = 5; y < 20; ++y) mask(y, 9) = 1;
  core::write_image(set / "mask.png", mask);
  db::import_pictures(store, db::read_diligent_set(set), "ball");
  const db::LoadedScan first = db::load_scan(store, "ball");
  db::export_lp(store, "ball", folder / "out");
  db::import_pictures(store, db::read_lp_set(folder / "out/ball.lp"), "again");
  const db::LoadedScan second = db::load_scan(store, "again");
  REQUIRE(second.scan.light_count() == 4);
  CHECK(second.scan.mask() == first.scan.mask());
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(core::angle_radians(first.scan.light(i).direction, second.scan.light(i).direction) < 1e-8);
    const auto &a = *first.scan.image(i), &b = *second.scan.image(i);
    REQUIRE(a.size() == b.size());
    // Dividing by the intensity left values between halves: one more rounding.
    for (std::size_t p = 0; p < a.values().size(); ++p)
      CHECK(a.values()[p] == Approx(b.values()[p]).epsilon(5e-4).margin(1e-7));
  }
  const auto before = test::snapshot(folder / "out");
  CHECK_THROWS_AS(db::export_lp(store, "ball", folder / "out"), core::UsageError);
  CHECK(test::snapshot(folder / "out") == before);
  fs::create_directory(folder / "empty");
  db::export_lp(store, "ball", (folder / "empty").string() + "/");
  CHECK(test::snapshot(folder / "empty") == before);
  CHECK_FALSE(fs::exists(folder / "empty.unfinished"));
}

TEST_CASE_METHOD(Fixture, "a failed export leaves nothing") {
  write_diligent();
  const db::Id id = db::import_pictures(store, db::read_diligent_set(set), "ball").scan_id;
  fs::resize_file(store.object_path(store.frames(id).back().object), 60);
  CHECK_THROWS_AS(db::export_lp(store, "ball", folder / "out"), core::StoreError);
  CHECK_FALSE(fs::exists(folder / "out"));
  CHECK_FALSE(fs::exists(folder / "out.unfinished"));
}

TEST_CASE_METHOD(Fixture, "a DiLiGenT set is linear and divided by its intensities") {
  write_diligent();
  db::import_pictures(store, db::read_diligent_set(set), "ball");
  const db::LoadedScan loaded = db::load_scan(store, "ball");
  const core::Image stored = core::read_image(set / "p3.png", {.encoding = core::Encoding::kLinear});
  const auto image = loaded.scan.image(3);
  for (int c = 0; c < 3; ++c) {
    CHECK((*image)(12, 10, c) == Approx(stored(12, 10, c) / std::array{1.0, 2.0, 4.0}[std::size_t(c)]).epsilon(1e-3));
  }
  CHECK(loaded.scan.light(3).gain == std::array{1.0, 2.0, 4.0});
}

TEST_CASE_METHOD(Fixture, "a DiLiGenT set without filenames.txt is numbered") {
  write_diligent();
  fs::remove(set / "filenames.txt");
  CHECK_THAT(diligent_refusal(), Equals((set / "light_directions.txt").string() +
                                        ": light 1 (there is no filenames.txt): the picture '001.png' is not there"));
  for (std::size_t i = 0; i < 4; ++i) fs::rename(set / name(i), set / ("00" + std::to_string(i + 1) + ".png"));
  CHECK(db::read_diligent_set(set).pictures[3].path.filename() == "004.png");
}

TEST_CASE_METHOD(Fixture, "a light without its picture is named with file and place") {
  write_pictures();
  write_text(set / "a.lp", lp_text());
  fs::remove(set / "p2.png");
  CHECK_THAT(lp_refusal(), Equals((set / "a.lp").string() + ": light 3 of 4: the picture 'p2.png' is not there"));
  fs::create_directory(set / "p2.png");
  CHECK_THAT(lp_refusal(), Equals((set / "a.lp").string() + ": light 3 of 4: the picture 'p2.png' is not a file"));
  fs::remove(set / "p2.png");
  write_diligent();
  fs::remove(set / "p1.png");
  CHECK_THAT(diligent_refusal(), Equals((set / "filenames.txt").string() + ":2: the picture 'p1.png' is not there"));
  CHECK_THAT(csv_refusal("file,x,y,z\np0.png,0,0,1\n\np1.png,0,1,1\n"),
             Equals((set / "lights.csv").string() + ":4: the picture 'p1.png' is not there"));
}

TEST_CASE_METHOD(Fixture, "a missing list of lights is named") {
  CHECK_THAT(lp_refusal(), Contains((set / "a.lp").string()));
  CHECK_THAT(diligent_refusal(), Contains((set / "light_directions.txt").string()));
  CHECK_THAT(refusal([&] { return db::read_csv_set(set); }), Contains((set / "lights.csv").string()));
  CHECK_THAT(refusal([&] { return db::read_diligent_set(set / "none"); }),
             Equals((set / "none").string() + ": there is no such folder"));
  CHECK_THAT(refusal([&] { return db::read_yale_set(set); }), Contains(set.string() + ": no picture named"));
}

TEST_CASE_METHOD(Fixture, "more lights than pictures, or fewer, are refused") {
  write_diligent();
  const std::string directions = test::read_text(set / "light_directions.txt");
  write_text(set / "light_directions.txt", directions + "0 0 1\n");
  CHECK_THAT(diligent_refusal(), Equals((set / "light_directions.txt").string() +
                                        ": 5 lights, but there are 4 pictures; every picture needs one line"));
  write_text(set / "light_directions.txt", directions.substr(0, directions.find('\n') + 1));
  CHECK_THAT(diligent_refusal(), Contains(": 1 lights, but there are 4 pictures"));
  write_text(set / "light_directions.txt", directions);
  write_text(set / "light_intensities.txt", "1 1 1\n");
  CHECK_THAT(diligent_refusal(), Contains((set / "light_intensities.txt").string() + ": 1 lights"));
  std::string five = lp_text();
  five[0] = '5';
  write_text(set / "a.lp", five);
  CHECK_THAT(lp_refusal(), Contains((set / "a.lp").string() + ":1: says 5 lights, but 4 follow"));
}

TEST_CASE_METHOD(Fixture, "directions and intensities that make no sense are refused at their line") {
  write_diligent();
  const auto with_line_2 = [&](const std::string& file, const std::string& line) {
    const std::string sound = test::read_text(set / file);
    const std::size_t start = sound.find('\n') + 1;
    std::string edited = sound;
    edited.replace(start, sound.find('\n', start) - start, line);
    write_text(set / file, edited);
    const std::string message = diligent_refusal();
    write_text(set / file, sound);
    CHECK_THAT(message, Contains((set / file).string() + ":2: "));
    return message;
  };
  CHECK_THAT(with_line_2("light_directions.txt", "0 0 0"), Contains("has no length"));
  CHECK_THAT(with_line_2("light_directions.txt", "0 nan 1"), Contains("'nan' is not a finite number"));
  CHECK_THAT(with_line_2("light_directions.txt", "0 1e999 1"), Contains("'1e999' is not a finite number"));
  CHECK_THAT(with_line_2("light_directions.txt", "0 x 1"), Contains("'x' is not a finite number"));
  CHECK_THAT(with_line_2("light_directions.txt", "0 1"), Contains("expected 3 numbers, found 2"));
  CHECK_THAT(with_line_2("light_directions.txt", "0 1 2 3"), Contains("expected 3 numbers, found 4"));
  CHECK_THAT(with_line_2("light_intensities.txt", "1 0 1"), Contains("greater than 0"));
  CHECK_THAT(with_line_2("light_intensities.txt", "1 -2 1"), Contains("greater than 0"));

  write_text(set / "a.lp", "2\np0.png 0 0 1\np1.png 0 0 0\n");
  CHECK_THAT(lp_refusal(), Contains((set / "a.lp").string() + ":3: ") && Contains("has no length"));
}

TEST_CASE_METHOD(Fixture, "pictures that cannot be used are named and nothing is stored") {
  write_pictures(".exr");
  write_text(set / "a.lp", lp_text(4, ".exr"));
  const fs::path last = set / "p3.exr";
  SECTION("a truncated EXR") {
    fs::resize_file(last, fs::file_size(last) - 200);
    CHECK_THAT(lp_refusal(), Contains(last.string()));
  }
  SECTION("an EXR that ends in its header") {
    fs::resize_file(last, 40);
    CHECK_THAT(lp_refusal(), Contains(last.string()));
  }
  SECTION("NaN pixels") {
    // core::write_image refuses NaN, other programs do not.
    core::Image image = test::lit_ball(lights[3], 24, 20);
    image(7, 5, 1) = std::nanf("");
    const auto file = OIIO::ImageOutput::create(last.string());
    REQUIRE(file->open(last.string(), OIIO::ImageSpec(20, 24, 3, OIIO::TypeDesc::HALF)));
    REQUIRE(file->write_image(OIIO::TypeDesc::FLOAT, image.values().data()));
    REQUIRE(file->close());
    const std::string message = lp_refusal();
    CHECK_THAT(message, Contains(last.string()) && Contains("nan") && Contains("5") && Contains("7"));
  }
  SECTION("another size") {
    core::write_image(last, test::lit_ball(lights[3], 24, 21));
    CHECK_THAT(lp_refusal(),
               Equals(last.string() + ": the picture is 21x24 colour, but p0.exr is 20x24 colour; all must be alike"));
  }
  SECTION("grey among colour") {
    core::write_image(last, test::lit_ball(lights[3], 24, 20, 1));
    CHECK_THAT(lp_refusal(), Contains(last.string() + ": the picture is 20x24 grey"));
  }
  SECTION("a mask of another size") {
    core::write_image(set / "mask.png", core::Image(23, 20, 1));
    CHECK_THAT(lp_refusal(), Contains((set / "mask.png").string() + ": the picture is 20x23"));
  }
  SECTION("a black mask") {
    core::write_image(set / "mask.png", core::Image(24, 20, 1));
    CHECK_THAT(lp_refusal(), Contains((set / "mask.png").string() + ": the mask is black everywhere"));
  }
  SECTION("not a picture") {
    write_text(last, "hello");
    CHECK_THAT(lp_refusal(), Contains(last.string()));
  }
}

TEST_CASE_METHOD(Fixture, "lists do not lead out of their folder") {
  write_pictures();
  core::write_image(folder / "secret.png", test::lit_ball(lights[0], 24, 20));
  const auto with_first = [&](const std::string& listed) {
    std::string text = lp_text();
    text.replace(text.find("p0.png"), 6, listed);
    write_text(set / "a.lp", text);
    return (set / "a.lp").string() + ": light 1 of 4: '" + listed +
           "' leads out of the folder; put the picture beside the list";
  };
  const std::string absolute = with_first((folder / "secret.png").string());
  CHECK_THAT(lp_refusal(), Equals(absolute));
  const std::string upwards = with_first("../secret.png");
  CHECK_THAT(lp_refusal(), Equals(upwards));
  fs::create_symlink(folder / "secret.png", set / "link.png");
  const std::string link = with_first("link.png");
  CHECK_THAT(lp_refusal(), Equals(link));
  fs::create_directory_symlink(folder.path(), set / "sub");
  const std::string link_folder = with_first("sub/secret.png");
  CHECK_THAT(lp_refusal(), Equals(link_folder));

  // Lists carry paths of the machine they were made on; the file name beside the list is what is meant then.
  with_first("C:\\scans\\lion\\p0.png");
  CHECK(db::read_lp_set(set / "a.lp").pictures[0].path == set / "p0.png");
  with_first("/home/somebody/p0.png");
  CHECK(db::read_lp_set(set / "a.lp").pictures[0].path == set / "p0.png");
  fs::create_directory(set / "jpg");
  fs::rename(set / "p0.png", set / "jpg/p0.png");
  with_first("jpg\\p0.png");
  CHECK(fs::equivalent(db::read_lp_set(set / "a.lp").pictures[0].path, set / "jpg/p0.png"));
}

TEST_CASE_METHOD(Fixture, "one picture cannot stand for two lights") {
  write_pictures();
  write_text(set / "a.lp", "3\np0.png 0 0 1\np1.png 0 1 1\n./p0.png 1 0 1\n");
  CHECK_THAT(lp_refusal(), Equals((set / "a.lp").string() + ": lights 1 and 3 both name the picture 'p0.png'"));
}

TEST_CASE_METHOD(Fixture, "a CSV names its columns in any order") {
  write_pictures();
  write_text(set / "lights.csv", "\xEF\xBB\xBFintensity, z,y,x,file\r\n2,1,0,0,p0.png\r\n4,0,3,0,\"p1.png\"\r\n");
  const db::PictureSet set_xyz = db::read_csv_set(set);
  REQUIRE(set_xyz.pictures.size() == 2);
  CHECK(set_xyz.pictures[0].direction.z() == 1);
  CHECK(set_xyz.pictures[1].direction.y() == 1);
  CHECK(set_xyz.pictures[1].intensity == std::array{4.0, 4.0, 4.0});

  write_text(set / "angles.csv", "file,longitude,latitude,r,g,b\np0.png,90,0,1,2,3\np1.png,0,-90,1,1,1\n");
  const db::PictureSet set_angles = db::read_csv_set(set / "angles.csv");
  CHECK(set_angles.pictures[0].direction.x() == Approx(1));
  CHECK(set_angles.pictures[1].direction.y() == Approx(-1));
  CHECK(set_angles.pictures[0].intensity == std::array{1.0, 2.0, 3.0});
}

TEST_CASE_METHOD(Fixture, "a CSV that makes no sense is refused at its line") {
  write_pictures();
  const std::string place = (set / "lights.csv").string();
  CHECK_THAT(csv_refusal("file,x,y\np0.png,0,1\n"), Equals(place + ":1: of the columns x to z only some are there"));
  CHECK_THAT(csv_refusal("file\np0.png\n"), Contains(place + ":1: the directions need either"));
  CHECK_THAT(csv_refusal("file,x,y,z,longitude,latitude\np0.png,0,1,0,0,0\n"),
             Contains(":1: the directions need either"));
  CHECK_THAT(csv_refusal("x,y,z\n0,0,1\n"), Equals(place + ":1: there is no column 'file'"));
  CHECK_THAT(csv_refusal("file,x,y,z,colour\np0.png,0,0,1,1\n"), Contains(":1: column 'colour' is not known"));
  CHECK_THAT(csv_refusal("file,x,y,z,x\np0.png,0,0,1,1\n"), Contains(":1: column 'x' comes twice"));
  CHECK_THAT(csv_refusal("file,x,y,z,r,g,b,intensity\np0.png,0,0,1,1,1,1,1\n"),
             Contains(":1: the strengths are given twice"));
  CHECK_THAT(csv_refusal("file,x,y,z\np0.png,0,0,1\np1.png,0,0\n"),
             Equals(place + ":3: 3 fields, but the header names 4"));
  CHECK_THAT(csv_refusal("file,x,y,z\np0.png,0,0,0\n"), Contains(place + ":2: ") && Contains("has no length"));
  CHECK_THAT(csv_refusal("file,x,y,z\np0.png,0,,1\n"), Equals(place + ":2: '' is not a finite number"));
  CHECK_THAT(csv_refusal("file,x,y,z\n\"p0.png,0,0,1\n"), Equals(place + ":2: a quote is not closed"));
  CHECK_THAT(csv_refusal("file,longitude,latitude\np0.png,0,91\n"),
             Equals(place + ":2: the latitude is beyond 90 degrees"));
  CHECK_THAT(csv_refusal("file,x,y,z,intensity\np0.png,0,0,1,0\n"), Contains(place + ":2: a light's intensity"));
  CHECK_THAT(csv_refusal("file,x,y,z\n"), Contains("expected a header line"));
}

TEST_CASE_METHOD(Fixture, "a Yale set has its directions in the names and its ambient light taken off") {
  const auto write = [&](const std::string& file, const core::Image& image) {
    core::write_image(set / file, image, {.pixel_type = core::PixelType::kUint8, .encoding = core::Encoding::kLinear});
  };
  core::Image lit(6, 4, 1), ambient(6, 4, 1);
  for (float& v : lit.values()) v = 100.0F / 255.0F;
  for (float& v : ambient.values()) v = 40.0F / 255.0F;
  write("yaleB09_P00A+070E+45.pgm", lit);
  write("yaleB09_P00A-025E-10.pgm", lit);
  write("yaleB09_P00_Ambient.pgm", ambient);
  write_text(set / "yaleB09_P00.info", "notes");
  const db::PictureSet found = db::read_yale_set(set);
  REQUIRE(found.pictures.size() == 2);
  CHECK(found.pictures[0].direction.x() < 0);  // positive azimuth is light from image left
  CHECK(found.pictures[0].direction.y() == Approx(std::sqrt(0.5)));
  CHECK(found.pictures[1].direction.x() > 0);
  CHECK(found.pictures[1].direction.y() < 0);
  db::import_pictures(store, found, "face");
  const db::LoadedScan loaded = db::load_scan(store, "face");
  CHECK(loaded.scan.light_count() == 2);
  CHECK((*loaded.scan.image(0))(3, 2) == Approx(60.0 / 255.0).epsilon(1e-3));
  CHECK(db::dark_level(store, store.scan("face"), "camera")(0, 0) == Approx(40.0 / 255.0).epsilon(1e-3));

  write("yaleB09_P00_Ambient.pgm", core::Image(12, 8, 1));
  CHECK_THAT(message_of([&] { db::read_yale_set(set); }),
             Equals((set / "yaleB09_P00_Ambient.pgm").string() +
                    ": the ambient picture is 8x12 pixels, the set 4x6; remove it or put one of the set's size there"));
  write("yaleB08_P00A+000E+00.pgm", lit);
  CHECK_THAT(message_of([&] { db::read_yale_set(set); }), Contains("several subjects or poses"));
}

TEST_CASE_METHOD(Fixture, "a nearly black picture and a torn one are set aside, and sound ones are not") {
  lights = test::front_lights(40);
  std::vector<core::Image> pictures;
  for (const core::Direction& light : lights) pictures.push_back(test::lit_ball(light, 48, 40));
  const auto import_as = [&](const std::string& scan) {
    for (std::size_t i = 0; i < pictures.size(); ++i) core::write_image(set / name(i, ".exr"), pictures[i]);
    write_text(set / "a.lp", lp_text(pictures.size(), ".exr"));
    return db::import_pictures(store, db::read_lp_set(set / "a.lp"), scan);
  };
  CHECK(import_as("sound").excluded.empty());
  for (float& v : pictures[6].values()) v *= 0.02F;
  for (int y = 0; y < 48; y += 2) {
    for (int x = 0; x < 40 * 3; ++x) pictures[13].pixel(y, 0)[x] *= 0.3F;
  }
  const db::ImportReport report = import_as("damaged");
  REQUIRE(report.excluded.size() == 2);
  CHECK(report.excluded[0].light_index == 6);
  CHECK_FALSE(report.excluded[0].placed);
  CHECK_THAT(report.excluded[0].reason, Contains("p6.exr: "));
  CHECK(report.excluded[1].light_index == 13);
  CHECK_THAT(report.excluded[1].reason, Contains("p13.exr: its rows do not fit"));
  // They stay in the store, but nothing uses them.
  CHECK(store.frames(report.scan_id).size() == 40);
  const db::LoadedScan loaded = db::load_scan(store, "damaged");
  CHECK(loaded.scan.light_count() == 38);
  CHECK(std::count(loaded.light_index.begin(), loaded.light_index.end(), 6) == 0);
  CHECK(std::count(loaded.light_index.begin(), loaded.light_index.end(), 13) == 0);
}

TEST_CASE_METHOD(Fixture, "of a large set a picture that cannot be read is named and left out, many end the import") {
  write_pictures(".exr", 20);
  write_text(set / "a.lp", lp_text(20, ".exr"));
  write_text(set / name(4, ".exr"), "hello");
  fs::resize_file(set / name(7, ".exr"), fs::file_size(set / name(7, ".exr")) - 200);
  const db::ImportReport report = db::import_pictures(store, db::read_lp_set(set / "a.lp"), "most");
  REQUIRE(report.excluded.size() == 2);
  CHECK(report.excluded[0].light_index == 4);
  CHECK(report.excluded[1].light_index == 7);
  CHECK_THAT(report.excluded[1].reason, Contains((set / "p7.exr").string()));
  const db::Scan scan = store.scan("most");
  CHECK(scan.steps.size() == 18);
  const db::LoadedScan loaded = db::load_scan(store, "most");
  REQUIRE(loaded.scan.light_count() == 18);
  CHECK(loaded.light_index[4] == 5);
  // The pictures after it still belong to their lights.
  CHECK((*loaded.scan.image(17))(12, 10) == Approx(test::lit_ball(lights[19], 24, 20)(12, 10)).epsilon(1e-3));
  CHECK(store.verify().errors == std::vector<std::string>());

  write_text(set / name(0, ".exr"), "");
  CHECK_THROWS_AS(db::import_pictures(store, db::read_lp_set(set / "a.lp"), "new"), core::BadInput);
  CHECK_THAT(message_of([&] { db::import_pictures(store, db::read_lp_set(set / "a.lp"), "new"); }),
             Contains((set / "p0.exr").string()) && Contains("3 of the set's 20 pictures cannot be read"));
  CHECK_FALSE(store.find_scan("new"));
}

TEST_CASE_METHOD(Fixture, "what is wrong with pictures is told from what they show") {
  std::size_t count = 40;
  int height = 48, width = 40;
  std::vector<core::Image> pictures;
  const auto render = [&] {
    lights = test::front_lights(count);
    pictures.clear();
    for (const core::Direction& light : lights) pictures.push_back(test::lit_ball(light, height, width));
  };
  const auto excluded = [&] {
    for (std::size_t i = 0; i < pictures.size(); ++i) core::write_image(set / name(i, ".exr"), pictures[i]);
    write_text(set / "a.lp", lp_text(pictures.size(), ".exr"));
    static int scans = 0;
    std::map<int, std::string> reasons;
    for (const db::CalibratedLight& light :
         db::import_pictures(store, db::read_lp_set(set / "a.lp"), "scan" + std::to_string(scans++)).excluded) {
      reasons[light.light_index] = light.reason;
    }
    return reasons;
  };
  const auto tear = [&](core::Image& picture) {
    for (int y = 0; y < height; y += 2)
      for (int x = 0; x < width * 3; ++x) picture.pixel(y, 0)[x] *= 0.3F;
  };
  SECTION("two neighbours swapped") {
    render();
    CHECK(excluded().empty());
    const std::size_t other = core::nearest_indices(lights, lights[11], 2).back();
    std::swap(pictures[11], pictures[other]);
    const auto found = excluded();
    REQUIRE(found.size() == 2);
    CHECK_THAT(found.at(11), Contains("swapped with p" + std::to_string(other) + ".exr"));
    CHECK_THAT(found.at(int(other)), Contains("swapped with p11.exr"));
  }
  SECTION("half of them black") {
    render();
    for (std::size_t i = 0; i < count; i += 2) pictures[i] = core::Image(height, width, 3);
    const auto found = excluded();
    REQUIRE(found.size() == count / 2);
    for (const auto& [light, reason] : found) {
      CHECK(light % 2 == 0);
      CHECK_THAT(reason, Contains("it is black (0.0 %"));
    }
  }
  SECTION("one of sixteen torn") {
    count = 16;
    render();
    CHECK(excluded().empty());
    tear(pictures[5]);
    const auto found = excluded();
    REQUIRE(found.size() == 1);
    CHECK_THAT(found.at(5), Contains("its rows do not fit"));
  }
  SECTION("pictures too small to tell") {
    height = width = 2;
    render();
    CHECK(excluded().empty());
  }
}
