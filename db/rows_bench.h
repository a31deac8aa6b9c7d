// Whether a store of a million frames is as quick to use as a small one.
#pragma once

#include <cstddef>
#include <filesystem>

namespace lightstage::db {

struct RowsBenchOptions {
  std::filesystem::path folder;  // of the store that is made; must not exist
  std::size_t rows = 1'000'000;  // frames, rounded up to whole scans
  std::size_t lights = 125;      // of each scan
  int cameras = 8;
};

// Times are of the first use after the catalogue has left the system's cache, milliseconds.
struct RowsBench {
  std::size_t rows = 0, scans = 0;
  double start_ms = 0;            // Store::open
  double list_ms = 0;             // opening it and Store::scan_summaries: `store ls`
  double verify_one_scan_ms = 0;  // opening it and Store::verify of one scan: `store verify SCAN`
  std::size_t catalogue_bytes = 0;
};

// Makes such a store, every scan of which has all its frames, and uses it. Rows are entered in bulk; of the objects only those of the scan that is verified are
// there (pictures of 32 x 32), the others are names, for which the catalogue does not care. 10 to 20 s and 600 bytes of disk a row.
RowsBench bench_rows(const RowsBenchOptions& options);

}  // namespace lightstage::db
