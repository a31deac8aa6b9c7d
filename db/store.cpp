#include "db/store.h"

#include <sqlite3.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "db/store/impl.h"

namespace lightstage::db {

namespace fs = std::filesystem;

Store::Store(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Store::Store(Store&&) noexcept = default;
Store& Store::operator=(Store&&) noexcept = default;
Store::~Store() = default;

Store Store::create(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder / "objects", error);
  if (error) throw core::StoreError(folder.string() + ": cannot be made: " + error.message());
  Store store(std::unique_ptr<Impl>(new Impl{folder, ObjectFiles(folder), create_catalogue(folder)}));
  sync_folder(folder);
  sync_folder(fs::absolute(folder).lexically_normal().parent_path());
  return store;
}

Store Store::open(const fs::path& folder) {
  return Store(std::unique_ptr<Impl>(new Impl{folder, ObjectFiles(folder), open_catalogue(folder)}));
}

const fs::path& Store::folder() const {
  return impl_->folder;
}

void Store::atomically(const std::function<void()>& work) {
  impl_->write(work);
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
  return {row.getColumn(0).getInt(), row.getColumn(1).getInt(), row.getColumn(2).getInt()};
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
