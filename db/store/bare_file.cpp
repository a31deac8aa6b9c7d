#include "db/store/bare_file.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <vector>

namespace lightstage::db {

struct BareFile::Impl {
  std::string name;  // SQLite looks for parameters behind the zero that ends it
  std::vector<std::max_align_t> memory;
  sqlite3_file* file = nullptr;  // null: could not be opened
};

BareFile::BareFile(const std::filesystem::path& path) : impl_(std::make_unique<Impl>()) {
  sqlite3_initialize();
  sqlite3_vfs* const layer = sqlite3_vfs_find("unix");
  if (layer == nullptr) return;
  impl_->name = std::filesystem::absolute(path).string() + std::string(4, '\0');
  impl_->memory.resize(std::size_t(layer->szOsFile) / sizeof(std::max_align_t) + 1);
  auto* const file = reinterpret_cast<sqlite3_file*>(impl_->memory.data());
  std::memset(impl_->memory.data(), 0, std::size_t(layer->szOsFile));
  const int result =
      layer->xOpen(layer, impl_->name.c_str(), file, SQLITE_OPEN_READONLY | SQLITE_OPEN_MAIN_DB, nullptr);
  if (result == SQLITE_OK) {
    impl_->file = file;
  } else if (file->pMethods != nullptr) {
    file->pMethods->xClose(file);
  }
}

BareFile::~BareFile() {
  if (impl_->file != nullptr) impl_->file->pMethods->xClose(impl_->file);
}

std::size_t BareFile::read(std::size_t offset, std::span<unsigned char> bytes) {
  sqlite3_int64 size = 0;
  if (impl_->file == nullptr || impl_->file->pMethods->xFileSize(impl_->file, &size) != SQLITE_OK) return 0;
  const std::size_t there = std::size_t(size) > offset ? std::min(bytes.size(), std::size_t(size) - offset) : 0;
  if (there == 0) return 0;
  const int result = impl_->file->pMethods->xRead(impl_->file, bytes.data(), int(there), sqlite3_int64(offset));
  return result == SQLITE_OK ? there : 0;
}

}  // namespace lightstage::db
