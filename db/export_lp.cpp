// A scan as a folder that RTI programs read.
#include <cstdio>

#include "core/error.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/unfinished_folder.h"
#include "db/scan_loader.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

std::string picture_name(int light_index) {
  char name[32];
  std::snprintf(name, sizeof name, "light_%04d.exr", light_index);
  return name;
}

}  // namespace

void export_lp(const Store& store, std::string_view name, const fs::path& folder) {
  const LoadedScan loaded = load_scan(store, name);
  core::UnfinishedFolder unfinished(folder);
  core::Progress progress("export " + std::string(name), loaded.scan.light_count());
  std::vector<core::LpEntry> entries;
  for (std::size_t i = 0; i < loaded.scan.light_count(); ++i) {
    core::throw_if_interrupted();
    const std::string picture = picture_name(loaded.light_index[i]);
    core::write_image(unfinished.path() / picture, *loaded.scan.image(i));
    entries.push_back({picture, loaded.scan.light(i).direction});
    progress.advance();
  }
  core::write_image(unfinished.path() / "mask.png", loaded.scan.mask());
  core::write_lp(unfinished.path() / (std::string(name) + ".lp"), entries);
  unfinished.finish();
}

}  // namespace lightstage::db
