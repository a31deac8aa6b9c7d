#include "db/rows_bench.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <random>

#include <SQLiteCpp/Statement.h>
#include <SQLiteCpp/Transaction.h>

#include "core/error.h"
#include "core/progress.h"
#include "core/stopwatch.h"
#include "db/store/impl.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr int kSide = 32;
constexpr std::size_t kScansPerTransaction = 50;

std::string name_of(std::size_t scan) {
  return "scan" + std::to_string(scan);
}

NewScan scan_of(const RowsBenchOptions& options, std::size_t number) {
  NewScan scan;
  scan.name = name_of(number);
  scan.stage_key = "bench-0000000000000000";
  for (int c = 0; c < options.cameras; ++c) scan.cameras.push_back("cam" + std::to_string(c));
  for (std::size_t i = 0; i < options.lights; ++i) {
    scan.steps.push_back({.step_index = int(i), .light_index = int(i), .exposure_ns = 20'000'000});
  }
  return scan;
}

// The scan that is verified: a real one.
void put_real_scan(Store& store, const RowsBenchOptions& options, std::size_t number) {
  const Id id = store.add_scan(scan_of(options, number));
  std::vector<UnsyncedFrame> frames;
  for (int c = 0; c < options.cameras; ++c)
    for (std::size_t i = 0; i < options.lights; ++i) {
      core::Image picture(kSide, kSide, 1);
      for (std::size_t v = 0; v < picture.values().size(); ++v) {
        picture.values()[v] = float((v * 7 + i * 13 + std::size_t(c) * 31) % 1009);
      }
      NewFrame frame;
      frame.scan_id = id;
      frame.camera = "cam" + std::to_string(c);
      frame.step_index = int(i);
      frames.push_back(store.begin_frame(frame, picture));
      if (frames.size() < 256) continue;
      store.finish_frames(std::move(frames));
      frames.clear();
    }
  store.finish_frames(std::move(frames));
}

// Scans whose objects are names alone.
void fill(const RowsBenchOptions& options, std::size_t first, std::size_t last) {
  SQLite::Database database = open_catalogue(options.folder);
  database.exec("PRAGMA synchronous = OFF");
  database.exec("PRAGMA foreign_keys = OFF");
  database.exec("PRAGMA cache_size = -400000");
  SQLite::Statement object(database, "INSERT INTO objects (hash, height, width, channels) VALUES (?, 1080, 1920, 1)");
  SQLite::Statement scan(database,
                         "INSERT INTO scans (name, kind, stage_key, provenance, created_utc, program_version) "
                         "VALUES (?, 'olat', ?, '{}', '2026-01-01T00:00:00Z', '1')");
  SQLite::Statement camera(database, "INSERT INTO cameras (scan_id, position, name) VALUES (?, ?, ?)");
  SQLite::Statement step(database,
                         "INSERT INTO steps (scan_id, step_index, kind, light_index, exposure_ns, pattern) "
                         "VALUES (?, ?, 'light', ?, ?, '')");
  SQLite::Statement frame(database,
                          "INSERT INTO frames (scan_id, camera, step_index, timestamp_ns, sequence_number, attempt, "
                          "saturation, object) VALUES (?, ?, ?, ?, ?, 1, 1, ?)");
  const auto run = [](SQLite::Statement& statement, const auto&... values) {
    bind_all(statement, values...);
    statement.exec();
    statement.reset();
  };
  std::mt19937_64 generator(first);
  core::Progress progress("entering scans", last - first);
  for (std::size_t begin = first; begin < last; begin += kScansPerTransaction) {
    SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
    for (std::size_t s = begin; s < std::min(last, begin + kScansPerTransaction); ++s) {
      const NewScan made = scan_of(options, s);
      run(scan, made.name, made.stage_key);
      const Id id = database.getLastInsertRowid();
      for (std::size_t c = 0; c < made.cameras.size(); ++c) run(camera, id, int(c), made.cameras[c]);
      for (const Step& entry : made.steps) run(step, id, entry.step_index, *entry.light_index, entry.exposure_ns);
      std::int64_t number = 0;
      for (const Step& entry : made.steps)
        for (const std::string& name : made.cameras) {
          ContentHash hash;
          for (std::uint8_t& byte : hash.bytes) byte = std::uint8_t(generator());
          run(object, hash);
          run(frame, id, name, entry.step_index, std::int64_t(number * 1'000'000), number, hash);
          ++number;
        }
      progress.advance();
    }
    transaction.commit();
  }
}

void drop_from_cache(const fs::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);  // only clean pages can be dropped
  ::posix_fadvise(descriptor, 0, 0, POSIX_FADV_DONTNEED);
  ::close(descriptor);
}

// No connection is open here: closing a file gives back all locks that a process has on it.
template <class Work>
double milliseconds(const fs::path& folder, const Work& work) {
  drop_from_cache(catalogue_path(folder));
  const core::Stopwatch watch;
  work();
  return 1000 * watch.seconds();
}

}  // namespace

RowsBench bench_rows(const RowsBenchOptions& options) {
  const std::size_t per_scan = options.lights * std::size_t(options.cameras);
  RowsBench result;
  result.scans = std::max<std::size_t>(1, (options.rows + per_scan - 1) / per_scan);
  const std::size_t real = result.scans / 2;
  Store::create(options.folder);
  explaining(options.folder, [&] {
    fill(options, 0, real);
    {
      Store store = Store::open(options.folder);
      put_real_scan(store, options, real);
    }
    fill(options, real + 1, result.scans);
  });
  result.catalogue_bytes = fs::file_size(catalogue_path(options.folder));
  result.start_ms = milliseconds(options.folder, [&] { Store::open(options.folder); });
  result.list_ms = milliseconds(options.folder, [&] {
    for (const ScanSummary& scan : Store::open(options.folder).scan_summaries()) result.rows += scan.frames;
  });
  result.verify_one_scan_ms = milliseconds(options.folder, [&] {
    const VerifyReport report = Store::open(options.folder).verify({.scans = {name_of(real)}});
    if (!report.errors.empty() || report.frames != per_scan) {
      throw core::StoreError(options.folder.string() + ": the bench's own scan is not whole");
    }
  });
  return result;
}

}  // namespace lightstage::db
