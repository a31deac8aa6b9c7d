#include "db/store/store_folder.h"

#include <sys/stat.h>

#include <cerrno>
#include <cstring>

#include "core/error.h"
#include "db/store/catalogue.h"

namespace lightstage::db {

namespace fs = std::filesystem;

void require_own_folders(const fs::path& store_folder) {
  for (const char* name : {"objects", "locks", "models"}) {
    std::error_code none;
    if (!fs::is_symlink(store_folder / name, none)) continue;
    throw core::StoreError((store_folder / name).string() +
                           ": is a symbolic link; objects, locks and models of a store lie in its own folder. Put what "
                           "it names in its place; nothing was touched");
  }
}

StorePlace::StorePlace(fs::path store_folder) : store_folder_(std::move(store_folder)) {
  struct stat status {};
  if (::stat(catalogue_path(store_folder_).c_str(), &status) != 0) {
    throw core::StoreError(catalogue_path(store_folder_).string() + ": " + std::strerror(errno));
  }
  device_ = status.st_dev;
  file_ = status.st_ino;
}

void StorePlace::require_unmoved() const {
  struct stat status {};
  const bool there = ::stat(catalogue_path(store_folder_).c_str(), &status) == 0;
  if (there && status.st_dev == device_ && status.st_ino == file_) return;
  throw core::StoreError(store_folder_.string() +
                         ": this store was moved or replaced while it was in use; nothing of this step was stored. "
                         "Name its new folder with --store and do it again");
}

}  // namespace lightstage::db
