#include <catch2/catch.hpp>

#include "core/error.h"
#include "db/load/light_image.h"
#include "db/scan_loader.h"
#include "db/scene.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using Catch::Matchers::Equals;
using test::message_of;

namespace {

core::Image constant(float value, int channels = 3) {
  core::Image image(4, 5, channels);
  for (float& v : image.values()) v = value;
  return image;
}

// Two dark steps and three lights seen by two cameras.
struct Fixture {
  test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  db::NewScan added = make_scan();
  db::Id scan_id = store.add_scan(added);

  static db::NewScan make_scan() {
    db::NewScan scan;
    scan.name = "head";
    scan.stage_key = "stage";
    scan.cameras = {"main", "side"};
    scan.steps = {{.step_index = 0, .kind = db::StepKind::kDark, .exposure_ns = 1},
                  {.step_index = 1, .kind = db::StepKind::kDark, .exposure_ns = 1},
                  {.step_index = 2, .kind = db::StepKind::kLight, .light_index = 5, .exposure_ns = 1},
                  {.step_index = 3, .kind = db::StepKind::kTracking, .exposure_ns = 1},
                  {.step_index = 4, .kind = db::StepKind::kLight, .light_index = 3, .exposure_ns = 1},
                  {.step_index = 5, .kind = db::StepKind::kLight, .light_index = 8, .exposure_ns = 1}};
    return scan;
  }
  void put(int step, const core::Image& image, const std::string& camera = "main", double saturation = 0) {
    store.put_frame({.scan_id = scan_id, .camera = camera, .step_index = step, .saturation = saturation}, image);
  }
  void put_all() {
    const std::array values{0.25F, 0.75F, 2.5F, 9.0F, 4.5F, 6.5F};
    for (int step = 0; step < 6; ++step) put(step, constant(values[std::size_t(step)]));
  }
  db::Id calibrate(bool place_8 = true) {
    std::vector<db::CalibratedLight> lights(3);
    for (std::size_t i = 0; i < 3; ++i) {
      lights[i].light_index = std::array{3, 5, 8}[i];
      lights[i].light.direction = core::Direction::from_vector({double(i), 1, 2});
      lights[i].light.gain = {1, 2, 4};
    }
    lights[2].placed = place_8;
    db::NewProduct product;
    product.kind = "calibration";
    product.stage_key = "stage";
    return store.add_calibration(product, lights);
  }
  db::Id add_images(const std::string& kind, const std::string& role, const std::map<int, core::Image>& images) {
    db::NewProduct product;
    product.kind = kind;
    product.scan_id = scan_id;
    for (const auto& [index, image] : images) product.images.push_back({role, index, store.put_object(image), 0});
    return store.add_product(product);
  }
};

}  // namespace

TEST_CASE_METHOD(Fixture, "loaded images are freed of ambient light and divided by the light's gain") {
  put_all();
  const db::Id calibration = calibrate();
  const db::LoadedScan loaded = db::load_scan(store, "head");
  CHECK(loaded.light_index == std::vector<int>{5, 3, 8});
  CHECK(loaded.calibration_id == calibration);
  CHECK_FALSE(loaded.alignment_id);
  CHECK_FALSE(loaded.mask_id);
  CHECK(loaded.scan.name() == "head");
  CHECK(loaded.scan.image_size() == core::ImageSize{4, 5, 3});
  CHECK(loaded.scan.masked_pixel_count() == 20);
  CHECK(core::angle_radians(loaded.scan.light(0).direction, core::Direction::from_vector({1, 1, 2})) < 1e-12);
  // The mean of the dark frames is 0.5.
  const auto image = loaded.scan.image(0);
  CHECK((*image)(3, 4, 0) == 2.0F);
  CHECK((*image)(3, 4, 1) == 1.0F);
  CHECK((*image)(3, 4, 2) == 0.5F);
  CHECK((*loaded.scan.image(1))(0, 0, 0) == 4.0F);
}

TEST_CASE_METHOD(Fixture, "one frame is freed of ambient light") {
  put_all();
  const db::Scan scan = store.scan("head");
  const core::Image dark = db::dark_level(store, scan, "main");
  CHECK(dark == constant(0.5F));
  const db::Frame frame = store.frames(scan_id, "main")[2];
  CHECK(db::load_frame(store, frame, dark) == constant(2.0F));
  CHECK(db::load_frame(store, frame, {}) == constant(2.5F));
  CHECK(db::dark_level(store, scan, "side").empty());
  CHECK_THROWS_AS(db::load_frame(store, frame, core::Image(4, 4, 3)), core::StoreError);
}

TEST_CASE_METHOD(Fixture, "lights that could not be placed are left out") {
  put_all();
  calibrate(false);
  CHECK(db::load_scan(store, "head").light_index == std::vector<int>{5, 3});
}

TEST_CASE_METHOD(Fixture, "aligned images come first, and are free of ambient light already") {
  put_all();
  calibrate();
  const db::Id mask = add_images("mask", "mask", {{0, constant(1, 1)}});
  const db::Id alignment = add_images("alignment", "aligned", {{2, constant(1)}, {4, constant(2)}, {5, constant(3)}});
  const db::LoadedScan aligned = db::load_scan(store, "head");
  CHECK(aligned.alignment_id == alignment);
  CHECK(aligned.mask_id == mask);
  CHECK((*aligned.scan.image(1))(0, 0, 0) == 2.0F);
  CHECK((*aligned.scan.image(1))(0, 0, 1) == 1.0F);
  const db::LoadedScan raw = db::load_scan(store, "head", {.camera = {}, .use_alignment = false, .nominal_lights = {}});
  CHECK_FALSE(raw.alignment_id);
  CHECK((*raw.scan.image(1))(0, 0, 0) == 4.0F);

  add_images("alignment", "aligned", {{2, constant(1)}, {4, constant(2)}});
  CHECK_THROWS_AS(db::load_scan(store, "head"), core::StoreError);
  CHECK_THAT(message_of([&] { db::load_scan(store, "head"); }),
             Equals("scan 'head', camera 'main', step 5 (light 8): the newest alignment lacks this frame; "
                    "run `lightstage align` again"));
}

TEST_CASE_METHOD(Fixture, "a light whose frame was excluded is there again once it was taken again") {
  put_all();
  calibrate();
  const auto align = [&](const std::vector<db::ProductImage>& images) {
    db::NewProduct product;
    product.kind = "alignment";
    product.scan_id = scan_id;
    product.images = images;
    store.add_product(product);
  };
  const db::ProductImage kept{"aligned", 2, store.put_object(constant(1)), 0},
      excluded{"excluded", 4, store.put_object(constant(2)), 0}, also{"aligned", 5, store.put_object(constant(3)), 0};
  align({kept, excluded, also});
  const std::vector<int> without = db::load_scan(store, "head").light_index;
  CHECK(std::count(without.begin(), without.end(), 3) == 0);

  db::Scan scan = store.scan("head");
  db::Step again = scan.steps.at(4);
  again.step_index = int(scan.steps.size());
  store.extend_scan(scan_id, {again}, R"({"more": 1})");
  CHECK(store.scan("head").steps.size() == scan.steps.size() + 1);
  CHECK(store.scan("head").provenance == R"({"more": 1})");
  CHECK_THROWS_AS(store.extend_scan(scan_id, {again}, "{}"), core::BadInput);
  CHECK(store.scan("head").provenance == R"({"more": 1})");
  // Planned, not taken: as before.
  CHECK(db::load_scan(store, "head").light_index == without);
  store.put_frame({.scan_id = scan_id, .camera = "main", .step_index = again.step_index}, constant(5));
  CHECK_THROWS_AS(db::load_scan(store, "head"), core::StoreError);
  align({kept, excluded, also, {"aligned", again.step_index, store.put_object(constant(7)), 0}});
  const db::LoadedScan loaded = db::load_scan(store, "head");
  const auto at = std::find(loaded.light_index.begin(), loaded.light_index.end(), 3);
  REQUIRE(at != loaded.light_index.end());
  CHECK((*loaded.scan.image(std::size_t(at - loaded.light_index.begin())))(0, 0, 0) == 7.0F);
}

TEST_CASE_METHOD(Fixture, "frames that the alignment excludes are left out") {
  put_all();
  calibrate();
  db::NewProduct product;
  product.kind = "alignment";
  product.scan_id = scan_id;
  product.images = {{"aligned", 2, store.put_object(constant(1)), 0},
                    {"excluded", 4, store.put_object(constant(2)), 0},
                    {"confidence", 4, store.put_object(constant(1, 1)), 0},
                    {"aligned", 5, store.put_object(constant(3)), 0}};
  core::Image seen = constant(1, 1);
  seen(2, 3) = 0;
  product.images.push_back({"seen", 0, store.put_object(seen), 0});
  store.add_product(product);
  const db::LoadedScan loaded = db::load_scan(store, "head");
  CHECK(loaded.scan.mask() == seen);
  core::Image mask(4, 5, 1);
  mask(2, 3) = mask(1, 1) = 1;
  add_images("mask", "mask", {{0, mask}});
  mask(2, 3) = 0;
  CHECK(db::load_scan(store, "head").scan.mask() == mask);
  CHECK(loaded.light_index == std::vector<int>{5, 8});
  CHECK((*loaded.scan.image(1))(0, 0, 0) > 2.0F / 3);
}

TEST_CASE_METHOD(Fixture, "the mask of the scan is the newest one") {
  put_all();
  calibrate();
  core::Image mask(4, 5, 1);
  mask(1, 2) = 1;
  add_images("mask", "mask", {{0, constant(1, 1)}});
  add_images("mask", "mask", {{0, mask}});
  CHECK(db::load_scan(store, "head").scan.mask() == mask);
}

TEST_CASE_METHOD(Fixture, "missing frames are refused with the first one's place") {
  put(0, constant(0));
  put(2, constant(1));
  calibrate();
  CHECK_THROWS_AS(db::load_scan(store, "head"), core::StoreError);
  CHECK_THAT(message_of([&] { db::load_scan(store, "head"); }),
             Equals("scan 'head', camera 'main', step 4 (light 3): the frame is missing; take it with "
                    "`lightstage capture --resume`"));
}

TEST_CASE_METHOD(Fixture, "nominal lights stand in only where nobody has calibrated") {
  put_all();
  CHECK_THROWS_AS(db::load_scan(store, "head"), core::UsageError);
  CHECK_THAT(message_of([&] { db::load_scan(store, "head"); }),
             Contains("'stage'") && Contains("lightstage calibrate"));
  db::LoadOptions options;
  options.nominal_lights.resize(6);
  options.nominal_lights[5].direction = core::Direction::from_vector({0, 1, 0});
  const db::LoadedScan nominal = db::load_scan(store, "head", options);
  CHECK_FALSE(nominal.calibration_id);
  CHECK(nominal.light_index == std::vector<int>{5, 3});
  CHECK(nominal.scan.light(0).direction.y() == 1);
  calibrate();
  CHECK(db::load_scan(store, "head", options).light_index == std::vector<int>{5, 3, 8});
}

TEST_CASE_METHOD(Fixture, "each camera has its own frames") {
  put_all();
  calibrate();
  for (int step = 0; step < 6; ++step) put(step, constant(1 + float(step), 1), "side");
  const db::LoadedScan side =
      db::load_scan(store, "head", {.camera = "side", .use_alignment = true, .nominal_lights = {}});
  CHECK(side.scan.image_size().channels == 1);
  // Grey: divided by the mean gain 7/3; the dark level is 1.5.
  CHECK((*side.scan.image(0))(0, 0) == Approx(1.5 / (7.0 / 3.0)));
  const db::LoadOptions wrong{.camera = "sidee", .use_alignment = true, .nominal_lights = {}};
  CHECK_THROWS_AS(db::load_scan(store, "head", wrong), core::UsageError);
  CHECK_THAT(message_of([&] { db::load_scan(store, "head", wrong); }),
             Equals("scan 'head' has no camera 'sidee' (did you mean 'side'?)"));
  CHECK_THROWS_AS(db::load_scan(store, "haed"), core::UsageError);
}

TEST_CASE_METHOD(Fixture, "images are read when they are used, also after the store is closed") {
  put_all();
  calibrate();
  const auto first = store.frames(scan_id, "main")[2], second = store.frames(scan_id, "main")[4];
  std::optional<db::LoadedScan> loaded;
  {
    const db::Store other = db::Store::open(folder / "store");
    loaded = db::load_scan(other, "head");
  }
  std::filesystem::remove(store.object_path(second.object));
  CHECK((*loaded->scan.image(0))(0, 0, 0) == 2.0F);
  CHECK_THROWS_AS(loaded->scan.image(1), core::StoreError);
}

TEST_CASE("a light shot with several exposures is one light of the scan") {
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  db::NewScan scan = test::olat_scan("a", 2);
  scan.steps.push_back({.step_index = 2, .kind = db::StepKind::kLight, .light_index = 0, .exposure_ns = 60'000'000});
  const db::Id id = store.add_scan(scan);
  store.put_frame({.scan_id = id, .camera = "main", .step_index = 0, .saturation = 8}, constant(1));
  store.put_frame({.scan_id = id, .camera = "main", .step_index = 1, .saturation = 8}, constant(4));
  store.put_frame({.scan_id = id, .camera = "main", .step_index = 2, .saturation = 8.0 / 3}, constant(2));
  db::LoadOptions options;
  options.nominal_lights.resize(2);
  const db::LoadedScan loaded = db::load_scan(store, "a", options);
  CHECK(loaded.light_index == std::vector<int>{0, 1});
  CHECK((*loaded.scan.image(0))(0, 0) == Approx(1.75).epsilon(1e-3));
  CHECK((*loaded.scan.image(1))(0, 0) == 4.0F);
}

TEST_CASE("every exposure of a bracket loses the dark frames of its own length, or of the longest") {
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  db::NewScan scan = test::olat_scan("a", 1);
  constexpr std::int64_t kMs = 1'000'000;
  using enum db::StepKind;
  scan.steps = {{.step_index = 0, .kind = kDark, .exposure_ns = 10 * kMs},
                {.step_index = 1, .kind = kDark, .exposure_ns = 40 * kMs},
                {.step_index = 2, .kind = kLight, .light_index = 0, .exposure_ns = 10 * kMs},
                {.step_index = 3, .kind = kLight, .light_index = 0, .exposure_ns = 40 * kMs},
                {.step_index = 4, .kind = kTracking, .exposure_ns = kMs}};
  const db::Id id = store.add_scan(scan);
  const auto put = [&](int step, float value, double saturation) {
    store.put_frame({.scan_id = id, .camera = "main", .step_index = step, .saturation = saturation}, constant(value));
  };
  put(0, 0.5F, 4);
  put(1, 0.25F, 1);
  put(2, 2.5F, 4);
  put(3, 1, 1);  // clipped
  put(4, 3, 40);
  CHECK(db::dark_level(store, store.scan(id), "main", 10 * kMs) == constant(0.5F));
  CHECK(db::dark_level(store, store.scan(id), "main", kMs) == constant(0.25F));
  CHECK(db::dark_level(store, store.scan(id), "main") == constant(0.25F));
  db::LoadOptions options;
  options.nominal_lights.resize(1);
  CHECK((*db::load_scan(store, "a", options).scan.image(0))(1, 1) == 2.0F);
}

TEST_CASE_METHOD(Fixture, "frames are divided by the camera's newest flat field, and colours follow its matrix") {
  put_all();
  calibrate();
  const auto add = [&](const std::string& kind, const std::string& parameters, const core::Image& flat) {
    db::NewProduct product;
    product.kind = kind;
    product.stage_key = "stage";
    product.parameters = parameters;
    if (!flat.empty()) product.images = {{"flat", 0, store.put_object(flat), 0}};
    return store.add_product(product);
  };
  core::Image flat = constant(1, 1);
  flat(1, 2) = 0.5F;
  add("flat_field", R"({"camera": "main"})", constant(0.25F, 1));
  const db::Id newest = add("flat_field", R"({"camera": "main"})", flat);
  add("flat_field", R"({"camera": "side"})", constant(0.25F, 1));
  const db::LoadedScan loaded = db::load_scan(store, "head");
  CHECK(loaded.flat_id == newest);
  CHECK((*loaded.scan.image(0))(0, 0, 0) == 2.0F);
  CHECK((*loaded.scan.image(0))(1, 2, 0) == 4.0F);
  const db::Scan scan = store.scan("head");
  const db::FlatField found = db::flat_field(store, scan, "main");
  CHECK(found.image == flat);
  CHECK(db::load_frame(store, store.frames(scan_id, "main")[2], constant(0.5F), found.image)(1, 2, 2) == 4.0F);

  // Aligned images were divided already where the alignment says so.
  db::NewProduct alignment;
  alignment.kind = "alignment";
  alignment.scan_id = scan_id;
  for (const int step : {2, 4, 5}) alignment.images.push_back({"aligned", step, store.put_object(constant(2)), 0});
  store.add_product(alignment);
  CHECK((*db::load_scan(store, "head").scan.image(0))(1, 2, 0) == 4.0F);
  alignment.input_products = {newest};
  store.add_product(alignment);
  const db::LoadedScan aligned = db::load_scan(store, "head");
  CHECK((*aligned.scan.image(0))(1, 2, 0) == 2.0F);
  CHECK_FALSE(aligned.flat_id);

  const db::Id colour = add("colour", R"({"matrix": [[0, 2, 0], [0, 0, 4], [1, 0, 0]]})", {});
  const db::LoadedScan coloured = db::load_scan(store, "head");
  CHECK(coloured.colour_id == colour);
  // Light 5 has gain 1, 2, 4.
  CHECK((*coloured.scan.image(0))(0, 0, 0) == 2.0F);
  CHECK((*coloured.scan.image(0))(0, 0, 1) == 2.0F);
  CHECK((*coloured.scan.image(0))(0, 0, 2) == 2.0F);
  CHECK(coloured.products().size() == 3);
  add("colour", R"({"matrix": [[0, 2, 0], [0, 0, 4]]})", {});
  CHECK_THROWS_AS(db::load_scan(store, "head"), core::StoreError);
}

TEST_CASE_METHOD(Fixture, "a flat field of another size is not used") {
  put_all();
  calibrate();
  db::NewProduct product;
  product.kind = "flat_field";
  product.stage_key = "stage";
  product.images = {{"flat", 0, store.put_object(core::Image(8, 10, 3)), 0}};
  store.add_product(product);
  const db::LoadedScan loaded = db::load_scan(store, "head");
  CHECK_FALSE(loaded.flat_id);
  CHECK((*loaded.scan.image(0))(0, 0, 0) == 2.0F);
}
