// Store: removing what nothing refers to.
#include <algorithm>
#include <set>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "db/store/backup_place.h"
#include "db/store/impl.h"
#include "db/store/scan_contents.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

// Nothing when the file is not there (any more).
std::optional<std::chrono::seconds> age_of(const fs::path& file) {
  std::error_code error;
  const auto written = fs::last_write_time(file, error);
  if (error) return std::nullopt;
  return std::chrono::duration_cast<std::chrono::seconds>(fs::file_time_type::clock::now() - written);
}

// Objects may belong to rows that only a catalogue that was put aside, or is gone, still has.
void refuse_where_rows_were_lost(const fs::path& folder) {
  if (const std::optional<fs::path> mark = holds_garbage(folder)) {
    throw core::StoreError(mark->string() +
                           ": the catalogue (or its log) that was here before a repair may have known more objects "
                           "than the one in use; nothing is "
                           "removed while this file is here. Move it away when all that you need is there again");
  }
}

}  // namespace

GarbageReport Store::collect_garbage(std::chrono::seconds age, bool only_look) {
  require_writable();
  refuse_where_rows_were_lost(folder());
  const core::FileLock alone = lock_objects(folder());
  const std::set<ContentHash> kept = explaining(folder(), [&] { return objects_of_kept(folder()); });
  GarbageReport report;
  const ObjectFiles::Listing listing = impl_->objects.list();
  const auto remove = [&](const fs::path& file, std::size_t& count) {
    const std::optional<std::chrono::seconds> old = age_of(file);
    if (!old) return false;
    if (*old < age) {
      ++report.kept_young;
      return false;
    }
    std::error_code error;
    const std::uintmax_t size = fs::file_size(file, error);
    if (!only_look) fs::remove(file, error);
    if (error) throw core::StoreError(file.string() + ": cannot be removed: " + error.message());
    ++count;
    report.bytes += size;
    return true;
  };
  // Writers enter their rows only while no batch is under way, and find out then that an object has gone (Impl::know_object).
  constexpr std::size_t kBatch = 256;
  core::Progress progress("looking for what nothing refers to", listing.objects.size());
  for (std::size_t begin = 0; begin < listing.objects.size(); begin += kBatch) {
    core::throw_if_interrupted();
    const std::size_t end = std::min(listing.objects.size(), begin + kBatch);
    impl_->write([&] {
      for (std::size_t i = begin; i < end; ++i) {
        const ContentHash& hash = listing.objects[i];
        if (kept.contains(hash) || is_referred_to(impl_->database, hash)) continue;
        if (remove(impl_->objects.path(hash), report.objects) && !only_look) {
          impl_->change("DELETE FROM objects WHERE hash = ?", hash);
        }
      }
    });
    progress.advance(end - begin);
  }
  for (const fs::path& stranger : listing.strangers) remove(stranger, report.files);
  return report;
}

}  // namespace lightstage::db
