#include "db/store.h"

#include <sqlite3.h>

#include <utility>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/nesting.h"
#include "db/store/foreign_catalogue.h"
#include "db/store/impl.h"

namespace lightstage::db {

namespace fs = std::filesystem;

Store::Store(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Store::Store(Store&&) noexcept = default;
Store& Store::operator=(Store&&) noexcept = default;
Store::~Store() = default;

Store Store::create(const fs::path& folder) {
  require_own_folders(folder);
  std::error_code error;
  fs::create_directories(folder / "objects", error);
  if (error) throw core::StoreError(folder.string() + ": cannot be made: " + error.message());
  Store store(
      std::unique_ptr<Impl>(new Impl{folder, ObjectFiles(folder), create_catalogue(folder), StorePlace(folder)}));
  sync_folder(folder);
  sync_folder(fs::absolute(folder).lexically_normal().parent_path());
  return store;
}

Store Store::open(const fs::path& folder) {
  return Store(
      std::unique_ptr<Impl>(new Impl{folder, ObjectFiles(folder), open_catalogue(folder), StorePlace(folder)}));
}

const fs::path& Store::folder() const {
  return impl_->folder;
}

void Store::atomically(const std::function<void()>& work) {
  impl_->write(work);
}

void Store::require_sound_catalogue() const {
  const auto found = explaining(folder(), [&] { return quick_finding(impl_->database); });
  if (!found) return;
  throw core::StoreError(folder().string() + ": the catalogue store.sqlite is damaged: " + *found +
                         "; `lightstage store verify` says more");
}

void Store::require_writable() const {
  // SQLite falls back to reading where it may not write, and lets even BEGIN IMMEDIATE pass then.
  if (sqlite3_db_readonly(impl_->database.getHandle(), "main") == 1) {
    throw explained(SQLite::Exception("read-only", SQLITE_READONLY), folder());
  }
}

ContentHash Store::put_object(core::ImageView image) {
  return impl_->objects.write(image);
}

core::ImageSize Store::Impl::size_of(const ContentHash& hash) const {
  auto row = query("SELECT height, width, channels FROM objects WHERE hash = ?", hash);
  // Not referred to yet: its file knows.
  if (!row.executeStep()) return objects.read_size(hash);
  const std::string what = folder.string() + ": object " + hash.hex() + ": its size";
  const core::ImageSize size{int_at(row, 0, what), int_at(row, 1, what), int_at(row, 2, what)};
  constexpr int kLongestSide = 1 << 20;
  const bool possible = size.height > 0 && size.width > 0 && size.height <= kLongestSide &&
                        size.width <= kLongestSide && size.channels > 0 && size.channels <= 4;
  if (!possible) throw core::StoreError(what + " is none that an image can have");
  // Memory is taken for an image before it is read, so for much memory the file is asked too.
  constexpr std::size_t kBelieved = std::size_t(1) << 26;  // values
  if (size.value_count() > kBelieved && objects.read_size(hash) != size) {
    throw core::StoreError(what + " is not that of its file");
  }
  return size;
}

void Store::Impl::know_object(const ContentHash& hash) {
  know_object(hash, size_of(hash));
}

void Store::Impl::know_object(const ContentHash& hash, core::ImageSize size) {
  // Collected as garbage, if it was long on its way here.
  if (!objects.exists(hash)) {
    throw core::StoreError(folder.string() + ": object " + hash.hex() +
                           " has been removed before anything referred to it");
  }
  change("INSERT OR IGNORE INTO objects (hash, height, width, channels) VALUES (?, ?, ?, ?)", hash, size.height,
         size.width, size.channels);
}

int int_at(const SQLite::Statement& row, int column, const std::string& what) {
  const std::int64_t value = row.getColumn(column).getInt64();
  if (!std::in_range<int>(value)) throw core::StoreError(what + " " + std::to_string(value) + " is out of range");
  return int(value);
}

std::string shallow_json(std::string text, const std::string& what) {
  if (core::json_nests_deeper(text, core::kMostJsonLevels)) {
    throw core::StoreError(what + " is nested more than " + std::to_string(core::kMostJsonLevels) + " levels deep");
  }
  return text;
}

core::Image Store::object(const ContentHash& hash) const {
  return impl_->objects.read(hash);
}

core::ImageSize Store::object_size(const ContentHash& hash) const {
  return explaining(folder(), [&] { return impl_->size_of(hash); });
}

fs::path Store::object_path(const ContentHash& hash) const {
  return impl_->objects.path(hash);
}

void require_json(const std::string& text, const std::string& what) {
  if (!nlohmann::json::accept(text)) throw core::BadInput(what + " is not JSON");
}

std::string json_or_empty(const std::string& text) {
  return text.empty() ? "{}" : text;
}

}  // namespace lightstage::db
