// A scan as a folder that RTI programs read.
#include <cstdio>

#include "core/error.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "db/scan_loader.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

void require_free(const fs::path& folder) {
  std::error_code none;
  if (!fs::exists(folder, none)) return;
  if (!fs::is_directory(folder, none) || !fs::is_empty(folder, none)) {
    throw core::UsageError(folder.string() + ": is there already and not an empty folder; choose another");
  }
}

// A folder beside the target, which becomes the target or is removed.
class UnfinishedFolder {
 public:
  explicit UnfinishedFolder(fs::path target) : target_(std::move(target)), path_(target_.string() + ".unfinished") {
    std::error_code error;
    if (fs::exists(path_, error)) {
      throw core::UsageError(path_.string() +
                             ": left by an export that was interrupted, or one that is running; remove it");
    }
    fs::create_directories(path_, error);
    if (error) throw core::BadInput(path_.string() + ": cannot be made: " + error.message());
  }
  ~UnfinishedFolder() {
    std::error_code ignored;
    if (!finished_) fs::remove_all(path_, ignored);
  }
  UnfinishedFolder(const UnfinishedFolder&) = delete;
  UnfinishedFolder& operator=(const UnfinishedFolder&) = delete;

  const fs::path& path() const { return path_; }
  void finish() {
    std::error_code error;
    fs::rename(path_, target_, error);  // replaces an empty folder
    if (error) throw core::BadInput(target_.string() + ": cannot be made: " + error.message());
    finished_ = true;
  }

 private:
  fs::path target_;
  fs::path path_;
  bool finished_ = false;
};

std::string picture_name(int light_index) {
  char name[32];
  std::snprintf(name, sizeof name, "light_%04d.exr", light_index);
  return name;
}

}  // namespace

void export_lp(const Store& store, std::string_view name, const fs::path& folder) {
  const LoadedScan loaded = load_scan(store, name);
  const fs::path target = fs::absolute(folder / "").lexically_normal().parent_path();
  require_free(target);
  UnfinishedFolder unfinished(target);
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
