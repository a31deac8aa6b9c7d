#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <limits>

#include "core/error.h"
#include "core/version.h"
#include "db/scene.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using Catch::Matchers::Equals;
using test::message_of;

namespace {

struct Fixture {
  test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  std::string place = (folder / "store").string() + ": ";
};

}  // namespace

TEST_CASE_METHOD(Fixture, "a scan comes back as it was added") {
  db::NewScan added;
  added.name = "head-01_a.b";
  added.kind = db::ScanKind::kMirrorBall;
  added.stage_key = "stage ω";
  added.provenance = R"({"sequence": {"lights": 3}, "text": "it's \"quoted\""})";
  added.cameras = {"z-left", "a-right"};
  added.steps = {{.step_index = 0, .kind = db::StepKind::kDark, .exposure_ns = 5},
                 {.step_index = 1, .kind = db::StepKind::kTracking, .exposure_ns = 6},
                 {.step_index = 2, .kind = db::StepKind::kFullOn, .exposure_ns = 7},
                 {.step_index = 3, .kind = db::StepKind::kLight, .light_index = 41, .exposure_ns = 1'000'000'000'000},
                 {.step_index = 9, .kind = db::StepKind::kPattern, .exposure_ns = 8, .pattern = "[[0,1,0.5,0]]"}};
  const db::Id id = store.add_scan(added);
  CHECK(id > 0);
  for (const db::Scan& scan : {store.scan(id), store.scan(added.name), store.find_scan(added.name).value()}) {
    CHECK(scan.id == id);
    CHECK(scan.name == added.name);
    CHECK(scan.kind == added.kind);
    CHECK(scan.stage_key == added.stage_key);
    CHECK(scan.provenance == added.provenance);
    CHECK(scan.cameras == added.cameras);
    CHECK(scan.program_version == core::kVersion);
    CHECK(scan.created_utc.size() == 20);
    REQUIRE(scan.steps.size() == added.steps.size());
    for (std::size_t i = 0; i < scan.steps.size(); ++i) {
      CHECK(scan.steps[i].step_index == added.steps[i].step_index);
      CHECK(scan.steps[i].kind == added.steps[i].kind);
      CHECK(scan.steps[i].light_index == added.steps[i].light_index);
      CHECK(scan.steps[i].exposure_ns == added.steps[i].exposure_ns);
      CHECK(scan.steps[i].pattern == added.steps[i].pattern);
    }
  }
  CHECK_FALSE(store.find_scan("other"));
}

TEST_CASE_METHOD(Fixture, "every kind of scan is kept") {
  using db::ScanKind;
  for (const ScanKind kind : {ScanKind::kOlat, ScanKind::kMirrorBall, ScanKind::kGreyBall, ScanKind::kChessboard,
                              ScanKind::kImported, ScanKind::kVirtual}) {
    db::NewScan scan = test::olat_scan(std::string(to_string(kind)), 1);
    scan.kind = kind;
    CHECK(store.scan(store.add_scan(scan)).kind == kind);
  }
}

TEST_CASE_METHOD(Fixture, "scans are refused by what is wrong with them") {
  store.add_scan(test::olat_scan("taken", 1));
  const auto refusal = [&](auto change) {
    db::NewScan scan = test::olat_scan("new", 2);
    change(scan);
    const std::string message = message_of([&] { store.add_scan(scan); });
    CHECK(store.scans().size() == 1);
    return message;
  };
  CHECK_THAT(refusal([](auto& s) { s.name = "taken"; }),
             Equals(place + "there is a scan 'taken' already; choose another name"));
  for (const std::string bad : {"", ".hidden", "a/b", "a b", "ä", "a'b"}) {
    CHECK_THAT(refusal([&](auto& s) { s.name = bad; }), Contains("'" + bad + "' cannot name a scan"));
  }
  CHECK_THAT(refusal([](auto& s) { s.cameras = {"a", "a"}; }), Equals("scan 'new': camera 'a' is listed twice"));
  CHECK_THAT(refusal([](auto& s) { s.steps[1].step_index = 0; }), Equals("scan 'new', step 0: listed twice"));
  CHECK_THAT(refusal([](auto& s) { s.steps[1].step_index = -1; }), Contains("step -1: steps count from 0"));
  CHECK_THAT(refusal([](auto& s) { s.steps[1].light_index.reset(); }),
             Contains("step 1: a step has a light exactly if"));
  CHECK_THAT(refusal([](auto& s) { s.steps[1].kind = db::StepKind::kDark; }), Contains("step 1: a step has a light"));
  CHECK_THAT(refusal([](auto& s) { s.steps[1].light_index = -4; }), Contains("step 1: lights count from 0"));
  CHECK_THAT(refusal([](auto& s) { s.steps[1].exposure_ns = -1; }), Contains("step 1: its exposure is negative"));
  CHECK_THAT(refusal([](auto& s) { s.steps[1].pattern = "[]"; }), Contains("step 1: only a step of kind 'pattern'"));
  CHECK_THAT(refusal([](auto& s) { s.provenance = "{"; }), Equals("scan 'new': its provenance is not JSON"));
}

TEST_CASE_METHOD(Fixture, "an unknown scan is refused with the name that was meant") {
  store.add_scan(test::olat_scan("head", 1));
  store.add_scan(test::olat_scan("ball", 1));
  CHECK_THROWS_AS(store.scan("haed"), core::UsageError);
  CHECK_THAT(message_of([&] { store.scan("heat"); }),
             Equals(place + "there is no scan 'heat' (did you mean 'head'?); `lightstage store ls` lists all"));
  CHECK_THAT(message_of([&] { store.scan("quite-different"); }),
             Equals(place + "there is no scan 'quite-different'; `lightstage store ls` lists all"));
  CHECK_THAT(message_of([&] { store.scan(db::Id(99)); }), Equals(place + "there is no scan with id 99"));
}

TEST_CASE_METHOD(Fixture, "frames come back in order of step, then camera as listed") {
  db::NewScan scan = test::olat_scan("a", 3);
  scan.cameras = {"z", "b"};
  const db::Id id = store.add_scan(scan);
  for (const int step : {2, 0, 1}) {
    for (const std::string camera : {"b", "z"}) {
      store.put_frame({.scan_id = id,
                       .camera = camera,
                       .step_index = step,
                       .timestamp_ns = 1'000'000'000'000'000 + step,
                       .sequence_number = 10 + step,
                       .attempt = 1 + step,
                       .saturation = 0.25 * step},
                      test::half_pattern(4, 5, 3, step));
    }
  }
  const auto all = store.frames(id);
  REQUIRE(all.size() == 6);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const int step = int(i / 2);
    CHECK(all[i].camera == (i % 2 == 0 ? "z" : "b"));
    CHECK(all[i].step_index == step);
    CHECK(all[i].timestamp_ns == 1'000'000'000'000'000 + step);
    CHECK(all[i].sequence_number == 10 + step);
    CHECK(all[i].attempt == 1 + step);
    CHECK(all[i].saturation == 0.25 * step);
    CHECK(store.object(all[i].object) == test::half_pattern(4, 5, 3, step));
    CHECK(store.object_size(all[i].object) == core::ImageSize{4, 5, 3});
  }
  CHECK(store.frames(id, "b").size() == 3);
  CHECK(store.frames(id, "nobody").empty());
}

TEST_CASE_METHOD(Fixture, "a retake replaces the frame") {
  const db::Id id = store.add_scan(test::olat_scan("a", 2));
  store.put_frame({.scan_id = id, .camera = "main", .step_index = 1}, test::half_pattern(4, 5, 3, 1));
  store.put_frame({.scan_id = id, .camera = "main", .step_index = 1, .attempt = 2}, test::half_pattern(6, 5, 3, 2));
  const auto frames = store.frames(id);
  REQUIRE(frames.size() == 1);
  CHECK(frames[0].attempt == 2);
  CHECK(store.object(frames[0].object) == test::half_pattern(6, 5, 3, 2));
}

TEST_CASE_METHOD(Fixture, "a frame that cannot be taken changes nothing") {
  const db::Id id = store.add_scan(test::olat_scan("a", 2));
  store.put_frame({.scan_id = id, .camera = "main", .step_index = 0}, test::half_pattern(4, 5, 3, 1));
  const auto before = test::snapshot(store.folder() / "objects");
  const std::string frame = place + "scan 'a', camera 'main', step 1: ";
  const auto refusal = [&](const db::NewFrame& frame_row, const core::Image& image) {
    CHECK_THROWS_AS(store.put_frame(frame_row, image), core::Error);
    const std::string message = message_of([&] { store.put_frame(frame_row, image); });
    CHECK(test::snapshot(store.folder() / "objects") == before);
    CHECK(store.frames(id).size() == 1);
    return message;
  };
  const core::Image sound = test::half_pattern(4, 5, 3, 2);
  for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity()}) {
    core::Image image = sound;
    image(2, 3, 1) = bad;
    const std::string message = refusal({.scan_id = id, .camera = "main", .step_index = 1}, image);
    CHECK_THAT(message, Contains("3") && Contains("2") && Contains(std::isnan(bad) ? "nan" : "inf"));
    CHECK_THROWS_AS(store.put_frame({.scan_id = id, .camera = "main", .step_index = 1}, image), core::BadInput);
  }
  CHECK_THAT(refusal({.scan_id = id, .camera = "main", .step_index = 1}, test::half_pattern(4, 6, 3, 2)),
             Equals(frame + "the image is 6x4 with 3 channels, the camera's other frames are 5x4 with 3 channels"));
  CHECK_THAT(refusal({.scan_id = id, .camera = "main", .step_index = 7}, sound), Contains("the scan has no such step"));
  CHECK_THAT(refusal({.scan_id = id, .camera = "side", .step_index = 1}, sound),
             Contains("the scan has no such camera"));
  CHECK_THAT(refusal({.scan_id = id + 5, .camera = "main", .step_index = 1}, sound),
             Contains("there is no scan with id"));
  CHECK_THAT(refusal({.scan_id = id, .camera = "main", .step_index = 1, .attempt = 0}, sound), Contains("attempts"));
  CHECK_THAT(refusal({.scan_id = id, .camera = "main", .step_index = 1, .saturation = std::nan("")}, sound),
             Contains("saturation"));
}

TEST_CASE_METHOD(Fixture, "objects hold every size and clamp to half floats") {
  for (const auto& [h, w, c] : {std::tuple{1, 1, 1}, {1, 1, 4}, {3, 17, 2}, {13, 3, 3}, {31, 37, 3}}) {
    const core::Image image = test::half_pattern(h, w, c, h);
    CHECK(store.object(store.put_object(image)) == image);
  }
  core::Image extreme(1, 4, 1);
  extreme(0, 0) = 1e6F;
  extreme(0, 1) = -1e6F;
  extreme(0, 2) = 5.960464477539063e-08F;  // the smallest half
  extreme(0, 3) = 65504;
  const core::Image back = store.object(store.put_object(extreme));
  CHECK(back(0, 0) == 65504);
  CHECK(back(0, 1) == -65504);
  CHECK(back(0, 2) == 5.960464477539063e-08F);
  CHECK(back(0, 3) == 65504);
  CHECK_THROWS_AS(store.put_object(core::Image()), core::BadInput);
  CHECK_THROWS_AS(store.put_object(core::Image(2, 2, 5)), core::BadInput);
}

TEST_CASE_METHOD(Fixture, "one image is one object, and a damaged one is mended by storing it again") {
  const core::Image image = test::half_pattern(9, 9, 3, 4);
  const db::ContentHash hash = store.put_object(image);
  const auto path = store.object_path(hash);
  CHECK(path == store.folder() / "objects" / hash.hex().substr(0, 2) / (hash.hex() + ".exr"));
  CHECK(db::hash_file(path) == hash);
  CHECK(store.put_object(image) == hash);

  std::filesystem::resize_file(path, 100);
  CHECK_THROWS_AS(store.object(hash), core::StoreError);
  CHECK_THAT(message_of([&] { store.object(hash); }),
             Equals(place + "object " + hash.hex() +
                    " is damaged: its bytes do not match its name; `lightstage store verify` names what it "
                    "belongs to"));
  CHECK(store.put_object(image) == hash);
  CHECK(store.object(hash) == image);

  std::filesystem::remove(path);
  CHECK_THAT(message_of([&] { store.object(hash); }), Contains("object " + hash.hex() + " is missing"));
}

TEST_CASE("a hash is XXH3-128 of the bytes, in canonical order") {
  // The published value for no bytes at all (xxHash's specification of XXH3, seed 0).
  CHECK(db::hash_bytes({}).hex() == "99aa06d3014798d86001c324468d497f");
  const test::TemporaryFolder folder;
  std::string text(3'000'001, 'a');  // several blocks of the stream
  text[2'000'000] = 'b';
  test::write_text(folder / "file", text);
  const std::span bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  const db::ContentHash hash = db::hash_file(folder / "file");
  CHECK(hash == db::hash_bytes(bytes));
  CHECK(db::ContentHash::from_hex(hash.hex()) == hash);
  CHECK_THROWS_AS(db::ContentHash::from_hex(hash.hex().substr(1)), core::StoreError);
  CHECK_THROWS_AS(db::ContentHash::from_hex("g" + hash.hex().substr(1)), core::StoreError);
  CHECK_THROWS_AS(db::hash_file(folder / "none"), core::StoreError);
  CHECK_THROWS_AS(db::hash_file(folder.path()), core::StoreError);
}

TEST_CASE_METHOD(Fixture, "products come back with their inputs and images") {
  const db::Id scan = store.add_scan(test::olat_scan("a", 1));
  const db::ContentHash hash = store.put_object(test::half_pattern(2, 2, 1, 0));
  db::NewProduct mask;
  mask.kind = "mask";
  mask.scan_id = scan;
  mask.images = {{"mask", 0, hash, 0.5}};
  const db::Id mask_id = store.add_product(mask);

  db::NewProduct weights;
  weights.kind = "weights";
  weights.name = "net";
  weights.parameters = R"({"steps": 10})";
  weights.input_scans = {scan};
  weights.input_products = {mask_id};
  const db::Id weights_id = store.add_product(weights);

  const db::Product back = store.product("weights", "net").value();
  CHECK(back.id == weights_id);
  CHECK(back.parameters == weights.parameters);
  CHECK_FALSE(back.scan_id);
  CHECK(back.input_scans == std::vector<db::Id>{scan});
  CHECK(back.input_products == std::vector<db::Id>{mask_id});
  CHECK(back.program_version == core::kVersion);
  const db::Product mask_back = store.newest_product("mask", scan).value();
  REQUIRE(mask_back.images.size() == 1);
  CHECK(mask_back.parameters == "{}");
  CHECK(mask_back.images[0].role == "mask");
  CHECK(mask_back.images[0].object == hash);
  CHECK(mask_back.images[0].value == 0.5);

  CHECK_THROWS_AS(store.add_product(weights), core::UsageError);
  CHECK_THAT(message_of([&] { store.add_product(weights); }),
             Equals(place + "there is a weights 'net' already; choose another name"));
  CHECK_FALSE(store.product("weights", "other"));
  CHECK_FALSE(store.product("mask", ""));
  mask.images[0].object = db::ContentHash();
  CHECK_THROWS_AS(store.add_product(mask), core::StoreError);
  mask.images[0].value = std::nan("");
  CHECK_THROWS_AS(store.add_product(mask), core::BadInput);
  weights.parameters = "none";
  CHECK_THROWS_AS(store.add_product(weights), core::BadInput);
  CHECK(store.products("mask").size() == 1);
}

TEST_CASE_METHOD(Fixture, "the newest product is found for each camera") {
  db::NewScan scan = test::olat_scan("a", 1);
  scan.cameras = {"left", "right"};
  const db::Id id = store.add_scan(scan);
  const auto add = [&](const std::string& parameters) {
    db::NewProduct product;
    product.kind = "alignment";
    product.scan_id = id;
    product.parameters = parameters;
    return store.add_product(product);
  };
  const db::Id unsaid = add("");
  CHECK(store.newest_product("alignment", store.scan(id), "left")->id == unsaid);
  CHECK_FALSE(store.newest_product("alignment", store.scan(id), "right"));
  const db::Id left = add(R"({"camera": "left"})"), right = add(R"({"camera": "right"})");
  CHECK(store.newest_product("alignment", store.scan(id), "left")->id == left);
  CHECK(store.newest_product("alignment", store.scan(id), "right")->id == right);
  CHECK(store.newest_product("alignment", id)->id == right);
}

TEST_CASE_METHOD(Fixture, "a calibration comes back light by light and the newest of a stage counts") {
  db::NewProduct product;
  product.kind = "calibration";
  product.stage_key = "stage";
  db::CalibratedLight near, lost;
  near.light_index = 7;
  near.light.direction = core::Direction::from_vector({1, -2, 3});
  near.light.position = core::Vec3{0.5, -1, 1.5};
  near.light.gain = {0.5, 1.25, 3};
  near.sigma_degrees = 0.125;
  lost.light_index = 2;
  lost.placed = false;
  lost.reason = "no highlight";
  const db::Id first = store.add_calibration(product, {near, lost});
  CHECK(store.newest_calibration("stage")->id == first);
  CHECK_FALSE(store.newest_calibration("other"));
  const auto lights = store.calibrated_lights(first);
  REQUIRE(lights.size() == 2);
  CHECK(lights[0].light_index == 2);
  CHECK_FALSE(lights[0].placed);
  CHECK(lights[0].reason == "no highlight");
  CHECK_FALSE(lights[0].light.position);
  CHECK(lights[1].placed);
  CHECK(core::angle_radians(lights[1].light.direction, near.light.direction) < 1e-15);
  CHECK(lights[1].light.position == near.light.position);
  CHECK(lights[1].light.gain == near.light.gain);
  CHECK(lights[1].sigma_degrees == 0.125);

  const db::Id second = store.add_calibration(product, {near});
  CHECK(store.newest_calibration("stage")->id == second);

  const auto refusal = [&](auto change) {
    db::CalibratedLight bad = near;
    change(bad);
    return message_of([&] { store.add_calibration(product, {lost, bad}); });
  };
  CHECK_THAT(refusal([](auto& l) { l.light_index = 2; }), Equals("calibration, light 2: listed twice"));
  CHECK_THAT(refusal([](auto& l) { l.light.gain[1] = 0; }), Contains("light 7: its gain"));
  CHECK_THAT(refusal([](auto& l) { l.light.gain[1] = std::nan(""); }), Contains("light 7: its gain"));
  CHECK_THAT(refusal([](auto& l) { l.sigma_degrees = std::nan(""); }), Contains("light 7: its sigma"));
  CHECK_THAT(refusal([](auto& l) { l.light.position->y = INFINITY; }), Contains("light 7: its position"));
  CHECK_THAT(refusal([](auto& l) { l.light_index = -1; }), Contains("lights count from 0"));
  product.kind = "mask";
  CHECK_THROWS_AS(store.add_calibration(product, {near}), core::BadInput);
  CHECK(store.products("calibration").size() == 2);
}

TEST_CASE_METHOD(Fixture, "removing a scan takes its own rows along, and is refused when others were made from it") {
  const db::Id a = store.add_scan(test::olat_scan("a", 1)), b = store.add_scan(test::olat_scan("b", 1));
  for (const db::Id id : {a, b}) {
    store.put_frame({.scan_id = id, .camera = "main", .step_index = 0}, test::half_pattern(4, 4, 3, int(id)));
  }
  db::NewProduct mask;
  mask.kind = "mask";
  mask.scan_id = a;
  mask.input_scans = {a};
  mask.images = {{"mask", 0, store.frames(a)[0].object, 0}};
  const db::Id own = store.add_product(mask);
  db::NewProduct heir;
  heir.kind = "picture";
  heir.name = "relit";
  heir.input_products = {own};
  const db::Id heir_id = store.add_product(heir);
  CHECK_THROWS_AS(store.remove_scan(a), core::UsageError);
  CHECK_THAT(message_of([&] { store.remove_scan(a); }),
             Equals(place + "scan 'a' cannot be removed: picture 'relit' (product " + std::to_string(heir_id) +
                    ") was made from it"));
  CHECK(store.scans().size() == 2);

  store.remove_scan(b);
  CHECK(store.scans().size() == 1);
  CHECK(store.frames(b).empty());
  const db::VerifyReport report = store.verify();
  CHECK(report.errors == std::vector<std::string>());
  REQUIRE(report.notes.size() == 1);
  CHECK_THAT(report.notes[0], Contains("1 object belongs to no frame or product"));
  CHECK(report.frames == 1);
  // A key once used never comes to mean another scan.
  CHECK(store.add_scan(test::olat_scan("c", 1)) > b);
  CHECK_THROWS_AS(store.remove_scan(b), core::UsageError);
}

TEST_CASE_METHOD(Fixture, "a scan's own products, made from one another, go with it") {
  const db::Id a = store.add_scan(test::olat_scan("a", 1));
  db::NewProduct mask;
  mask.kind = "mask";
  mask.scan_id = a;
  mask.input_scans = {a};
  db::NewProduct alignment;
  alignment.kind = "alignment";
  alignment.scan_id = a;
  alignment.input_products = {store.add_product(mask)};
  store.add_product(alignment);
  store.remove_scan(a);
  CHECK(store.scans().empty());
  CHECK(store.products("mask").empty());
  CHECK(store.products("alignment").empty());
  CHECK(store.verify().errors == std::vector<std::string>());
}

TEST_CASE_METHOD(Fixture, "weights trained on a scan lose their entry with it, and are told of") {
  const db::Id a = store.add_scan(test::olat_scan("a", 1)), b = store.add_scan(test::olat_scan("b", 1));
  for (const db::Id id : {a, b}) {
    store.put_frame({.scan_id = id, .camera = "main", .step_index = 0}, test::half_pattern(4, 4, 3, int(id)));
  }
  db::NewProduct mask;
  mask.kind = "mask";
  mask.scan_id = a;
  const db::Id own = store.add_product(mask);
  const auto weights = [&](const std::string& name, std::vector<db::Id> scans, std::vector<db::Id> products) {
    db::NewProduct product;
    product.kind = "weights";
    product.name = name;
    product.parameters = R"({"file": "/models/)" + name + R"("})";
    product.input_scans = std::move(scans);
    product.input_products = std::move(products);
    return store.add_product(product);
  };
  weights("of_a", {a}, {own});
  const db::Id of_both = weights("of_both", {b, a}, {});
  weights("of_b", {b}, {});
  weights("of_mask", {}, {own});

  db::NewProduct picture;  // of another scan, by a model that saw this one
  picture.kind = "picture";
  picture.scan_id = b;
  picture.input_products = {of_both};
  store.add_product(picture);
  CHECK_THAT(message_of([&] { store.remove_scan(a); }), Contains("'a' cannot be removed: picture"));
  CHECK(store.products("weights").size() == 4);
  store.remove_scan(store.add_scan(test::olat_scan("c", 1)));

  const db::Id d = store.add_scan(test::olat_scan("d", 1));
  weights("of_d", {d, b}, {});
  const std::vector<db::Product> gone = store.remove_scan(d);
  REQUIRE(gone.size() == 1);
  CHECK(gone[0].name == "of_d");
  CHECK_THAT(gone[0].parameters, Contains("/models/of_d"));
  CHECK(store.products("weights").size() == 4);
  CHECK(store.verify().errors == std::vector<std::string>());
}

namespace {

// As somebody who may read the store's files and write none. The superuser may write whatever their permissions, and so becomes nobody.
class ReadingOnly {
 public:
  explicit ReadingOnly(const std::filesystem::path& folder) : folder_(folder) {
    namespace fs = std::filesystem;
    fs::permissions(folder.parent_path(), fs::perms(0755));
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (entry.is_regular_file()) fs::permissions(entry, fs::perms(0444));
    }
    fs::permissions(folder, fs::perms(0555));
    constexpr uid_t kNobody = 65534;
    if (user_ == 0) REQUIRE(seteuid(kNobody) == 0);
  }
  ~ReadingOnly() {
    if (seteuid(user_) == 0) std::filesystem::permissions(folder_, std::filesystem::perms(0755));
  }
  ReadingOnly(const ReadingOnly&) = delete;
  ReadingOnly& operator=(const ReadingOnly&) = delete;

 private:
  std::filesystem::path folder_;
  uid_t user_ = geteuid();
};

}  // namespace

TEST_CASE_METHOD(Fixture, "that a store cannot be written is known before long work") {
  store.add_scan(test::olat_scan("a", 1));
  store.require_writable();
  const ReadingOnly reading_only(folder / "store");
  // Opens, since the log and its index are there: `store` holds them.
  db::Store other = db::Store::open(folder / "store");
  CHECK(other.scans().size() == 1);
  CHECK_THROWS_AS(other.require_writable(), core::StoreError);
  CHECK_THAT(message_of([&] { other.require_writable(); }), Contains(place) && Contains("writing"));
}
