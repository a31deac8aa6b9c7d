// Stores from strangers: pages of the catalogue changed (catalogue), and rows that no lightstage would write (rows).
#include <SQLiteCpp/Database.h>
#include <SQLiteCpp/Statement.h>

#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>

#include "capture/sequence.h"
#include "capture/stage.h"
#include "cli/jobs/provenance.h"
#include "cli/jobs/stage_cameras.h"
#include "core/config.h"
#include "db/scan_loader.h"
#include "db/store.h"
#include "db/store/page_checks.h"
#include "fuzz/target.h"

namespace lightstage::fuzz {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLights = 4;

// A small store with something in every table.
void fill(db::Store& store) {
  cli::CaptureProvenance provenance;
  provenance.stage = capture::make_stage("tiny", {.lights = kLights, .camera_pixels = 8, .cameras = 2});
  provenance.sequence = capture::make_olat_sequence({.light_count = kLights});
  provenance.pass_steps = provenance.sequence.steps.size();
  db::NewScan scan;
  scan.name = "head";
  scan.stage_key = capture::stage_key(provenance.stage);
  scan.provenance = cli::to_json(provenance);
  for (const capture::StageCamera& camera : provenance.stage.cameras) scan.cameras.push_back(camera.name);
  scan.steps = provenance.sequence.steps;
  const db::Id id = store.add_scan(scan);
  core::Image picture(8, 8, 3);
  for (const std::string& camera : scan.cameras) {
    for (const db::Step& step : scan.steps) {
      for (float& v : picture.values()) v = float(step.step_index + 1) / 64;
      store.put_frame({.scan_id = id, .camera = camera, .step_index = step.step_index}, picture);
    }
  }
  db::NewProduct mask{.kind = "mask", .scan_id = id, .input_scans = {id}};
  core::Image white(8, 8, 1);
  for (float& v : white.values()) v = 1;
  mask.images = {{"mask", 0, store.put_object(white), 0}};
  const db::Id mask_id = store.add_product(mask);
  db::NewProduct calibration{.kind = "calibration", .scan_id = id, .stage_key = scan.stage_key};
  calibration.input_products = {mask_id};
  std::vector<db::CalibratedLight> lights;
  for (const core::Light& light : capture::nominal_lights(provenance.stage)) {
    lights.push_back({.light_index = int(lights.size()), .light = light});
  }
  store.add_calibration(calibration, lights);
  std::string cameras;
  for (const capture::StageCamera& camera : provenance.stage.cameras) {
    cameras += (cameras.empty() ? "" : ",") + cli::camera_json(camera).dump();
  }
  store.add_product(
      {.kind = "camera_calibration", .stage_key = scan.stage_key, .parameters = R"({"cameras":[)" + cameras + "]}"});
  store.add_product(
      {.kind = "colour", .stage_key = scan.stage_key, .parameters = R"({"matrix":[[1,0,0],[0,1,0],[0,0,1]]})"});
  store.add_product({.kind = "weights",
                     .name = "net",
                     .scan_id = id,
                     .parameters = R"({"file":"net.safetensors","hash":""})",
                     .input_scans = {id}});
}

const fs::path& store_folder() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "store";
    fs::remove_all(made);
    db::Store store = db::Store::create(made);
    fill(store);
    return made;
  }();
  return folder;
}

// The catalogue as it was made, byte by byte, all of it in the one file.
const std::string& sound_catalogue() {
  static const std::string bytes = [] {
    const fs::path file = store_folder() / "store.sqlite";
    SQLite::Database(file.string(), SQLite::OPEN_READWRITE).exec("PRAGMA wal_checkpoint(TRUNCATE)");
    std::ifstream stream(file, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  }();
  return bytes;
}

void put_catalogue(std::string_view bytes) {
  for (const char* suffix : {"-wal", "-shm", "-journal"})
    fs::remove(store_folder() / (std::string("store.sqlite") + suffix));
  write(store_folder() / "store.sqlite", bytes);
}

// What commands ask of a store, whatever they find.
void use_store() {
  db::Store store = db::Store::open(store_folder());
  tolerate([&] { store.require_sound_catalogue(); });
  tolerate([&] { store.scan_summaries(); });
  std::vector<db::Scan> scans;
  tolerate([&] { scans = store.scans(); });
  for (const db::Scan& scan : scans) {
    for (const std::string& camera : scan.cameras) {
      tolerate([&] { store.frames(scan.id, camera); });
      tolerate([&] {
        const db::LoadedScan loaded = db::load_scan(store, scan.name, {.camera = camera});
        loaded.scan.image(0);
        loaded.scan.exposure();
      });
      tolerate([&] { db::dark_level(store, scan, camera); });
      tolerate([&] { db::flat_field(store, scan, camera); });
    }
    tolerate([&] { cli::capture_provenance(scan); });
    tolerate([&] { cli::calibrated_provenance(store, scan); });
    tolerate([&] { cli::key_step(scan); });
  }
  for (const char* kind : {"mask", "calibration", "camera_calibration", "colour", "weights"}) {
    std::vector<db::Product> products;
    tolerate([&] { products = store.products(kind); });
    for (const db::Product& product : products) tolerate([&] { store.calibrated_lights(product.id); });
  }
  tolerate([&] { store.verify(); });
  tolerate([&] { store.collect_garbage(std::chrono::seconds(3600), true); });
  for (const db::Scan& scan : scans) tolerate([&] { store.remove_scan(scan.id); });
}

// Patches: an offset of three bytes, a length, and so many bytes to write there.
const Registration kCatalogue({"catalogue",
                               [](Bytes bytes) {
                                 std::string catalogue = sound_catalogue();
                                 Input input(bytes);
                                 while (!input.empty()) {
                                   const std::size_t at = input.number(3) % catalogue.size();
                                   const Bytes patch = input.take(std::size_t(input.byte() % 64) + 1);
                                   for (std::size_t i = 0; i < patch.size() && at + i < catalogue.size(); ++i) {
                                     catalogue[at + i] = char(patch[i]);
                                   }
                                 }
                                 put_catalogue(catalogue);
                                 use_store();
                               },
                               4096, 20});

struct Column {
  const char* table;
  const char* name;
};
constexpr std::array kColumns{
    Column{"objects", "hash"},
    Column{"objects", "height"},
    Column{"objects", "width"},
    Column{"objects", "channels"},
    Column{"scans", "name"},
    Column{"scans", "kind"},
    Column{"scans", "stage_key"},
    Column{"scans", "provenance"},
    Column{"scans", "created_utc"},
    Column{"cameras", "position"},
    Column{"cameras", "name"},
    Column{"steps", "step_index"},
    Column{"steps", "kind"},
    Column{"steps", "light_index"},
    Column{"steps", "exposure_ns"},
    Column{"steps", "pattern"},
    Column{"frames", "camera"},
    Column{"frames", "step_index"},
    Column{"frames", "attempt"},
    Column{"frames", "saturation"},
    Column{"frames", "object"},
    Column{"products", "kind"},
    Column{"products", "name"},
    Column{"products", "scan_id"},
    Column{"products", "stage_key"},
    Column{"products", "parameters"},
    Column{"product_images", "role"},
    Column{"product_images", "image_index"},
    Column{"product_images", "object"},
    Column{"product_images", "value"},
    Column{"calibrated_lights", "light_index"},
    Column{"calibrated_lights", "placed"},
    Column{"calibrated_lights", "direction_x"},
    Column{"calibrated_lights", "direction_y"},
    Column{"calibrated_lights", "direction_z"},
    Column{"calibrated_lights", "position_x"},
    Column{"calibrated_lights", "gain_r"},
    Column{"calibrated_lights", "sigma_degrees"},
    Column{"identity", "store_id"},
    Column{"product_input_scans", "scan_id"},
    Column{"product_input_products", "input_id"},
};
constexpr std::array<std::int64_t, 8> kIntegers{
    0, -1, 1, std::int64_t(1) << 62, std::numeric_limits<std::int64_t>::min(), 2147483647, 2147483648, 1000000};
constexpr std::array<double, 7> kReals{0, -1, HUGE_VAL, -HUGE_VAL, 1e-320, 1e300, 0.5};

// Sets a column of a row, or of all, past every check.
void set(SQLite::Database& database, Input& input) {
  const Column& column = kColumns[input.byte() % kColumns.size()];
  const int row = input.byte();
  const std::string which = row == 255 ? ""
                                       : " WHERE rowid = (SELECT rowid FROM " + std::string(column.table) +
                                             " LIMIT 1 OFFSET " + std::to_string(row % 16) + ")";
  SQLite::Statement statement(database,
                              "UPDATE OR IGNORE " + std::string(column.table) + " SET " + column.name + " = ?" + which);
  switch (input.byte() % 6) {
    case 0:
      statement.bind(1);
      break;
    case 1:
      statement.bind(1, kIntegers[input.byte() % kIntegers.size()]);
      break;
    case 2:
      statement.bind(1, kReals[input.byte() % kReals.size()]);
      break;
    case 3:
      statement.bind(1, std::int64_t(input.number(8)));
      break;
    case 4: {
      const Bytes text = input.take(input.byte());
      statement.bind(1, std::string(text_of(text)));
      break;
    }
    default:
      statement.bind(1, std::string(input.byte() * 1000, '['));
  }
  try {
    statement.exec();
  } catch (const SQLite::Exception&) {  // NULL or a text where the table takes none
  }
}

const Registration kRows({"rows",
                          [](Bytes bytes) {
                            put_catalogue(sound_catalogue());
                            {
                              SQLite::Database database =
                                  db::open_checked(store_folder() / "store.sqlite", SQLite::OPEN_READWRITE);
                              database.exec("PRAGMA ignore_check_constraints = ON");
                              database.exec("PRAGMA foreign_keys = OFF");
                              database.exec("PRAGMA synchronous = OFF");
                              database.exec("BEGIN");
                              Input input(bytes);
                              for (int changes = 0; !input.empty() && changes < 50; ++changes) set(database, input);
                              database.exec("COMMIT");
                            }
                            use_store();
                          },
                          4096, 20});

}  // namespace

}  // namespace lightstage::fuzz
