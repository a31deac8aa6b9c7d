#include "db/store/bare_file.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <vector>

namespace lightstage::db {

namespace {

// A file that SQLite's own layer has opened.
class LayerFile {
 public:
  LayerFile(const std::filesystem::path& path, int flags) {
    sqlite3_initialize();
    sqlite3_vfs* const layer = sqlite3_vfs_find("unix");
    if (layer == nullptr) return;
    name_ = std::filesystem::absolute(path).string() + std::string(4, '\0');
    memory_.resize(std::size_t(layer->szOsFile) / sizeof(std::max_align_t) + 1);
    auto* const file = reinterpret_cast<sqlite3_file*>(memory_.data());
    std::memset(memory_.data(), 0, std::size_t(layer->szOsFile));
    const int result = layer->xOpen(layer, name_.c_str(), file, flags | SQLITE_OPEN_MAIN_DB, nullptr);
    if (result == SQLITE_OK) {
      file_ = file;
    } else if (file->pMethods != nullptr) {
      file->pMethods->xClose(file);
    }
  }
  ~LayerFile() {
    if (file_ != nullptr) file_->pMethods->xClose(file_);
  }
  LayerFile(const LayerFile&) = delete;
  LayerFile& operator=(const LayerFile&) = delete;

  sqlite3_file* get() const { return file_; }  // null: could not be opened

 private:
  std::string name_;  // SQLite looks for parameters behind the zero that ends it
  std::vector<std::max_align_t> memory_;
  sqlite3_file* file_ = nullptr;
};

}  // namespace

struct BareFile::Impl {
  LayerFile file;
};

BareFile::BareFile(const std::filesystem::path& path) : impl_(new Impl{LayerFile(path, SQLITE_OPEN_READONLY)}) {}

BareFile::~BareFile() = default;

std::size_t BareFile::read(std::size_t offset, std::span<unsigned char> bytes) {
  sqlite3_file* const file = impl_->file.get();
  sqlite3_int64 size = 0;
  if (file == nullptr || file->pMethods->xFileSize(file, &size) != SQLITE_OK) return 0;
  const std::size_t there = std::size_t(size) > offset ? std::min(bytes.size(), std::size_t(size) - offset) : 0;
  if (there == 0) return 0;
  const int result = file->pMethods->xRead(file, bytes.data(), int(there), sqlite3_int64(offset));
  return result == SQLITE_OK ? there : 0;
}

struct NobodyElse::Impl {
  LayerFile file;
  bool alone = false;
};

NobodyElse::NobodyElse(const std::filesystem::path& catalogue)
    : impl_(new Impl{LayerFile(catalogue, SQLITE_OPEN_READWRITE)}) {
  sqlite3_file* const file = impl_->file.get();
  if (file == nullptr) return;
  impl_->alone = file->pMethods->xLock(file, SQLITE_LOCK_SHARED) == SQLITE_OK &&
                 file->pMethods->xLock(file, SQLITE_LOCK_EXCLUSIVE) == SQLITE_OK;
}

NobodyElse::~NobodyElse() {
  if (sqlite3_file* const file = impl_->file.get()) file->pMethods->xUnlock(file, SQLITE_LOCK_NONE);
}

NobodyElse::operator bool() const {
  return impl_->alone;
}

}  // namespace lightstage::db
