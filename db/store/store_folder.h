// The folder of a store: that it is the store's own, and stays where it is.
#pragma once

#include <sys/types.h>

#include <filesystem>

namespace lightstage::db {

// Throws StoreError where `objects`, `locks` or `models` in this folder is a symbolic link, which somebody's own files would be written and removed
// through. To be called before anything is done to a store or a backup; what is not there yet is no fault.
void require_own_folders(const std::filesystem::path& store_folder);

// The store that was found in a folder, by its catalogue's file. Whoever moves a store away while a program works on it, and perhaps puts another one
// in its place, would otherwise have new objects here and their rows there.
class StorePlace {
 public:
  // Throws StoreError when there is no catalogue.
  explicit StorePlace(std::filesystem::path store_folder);
  // Throws StoreError when the folder does not hold that store any more. Costs one look at a name.
  void require_unmoved() const;

 private:
  std::filesystem::path store_folder_;
  dev_t device_ = 0;
  ino_t file_ = 0;
};

}  // namespace lightstage::db
