// Store: mending objects by sound copies.
#include <map>
#include <set>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "db/store/impl.h"
#include "db/store/scan_contents.h"

namespace lightstage::db {

namespace fs = std::filesystem;

RepairReport Store::repair(const std::vector<fs::path>& backups) {
  require_writable();
  for (const fs::path& backup : backups) {
    require_own_folders(backup);
    std::error_code error;
    if (!fs::is_directory(backup / "objects", error)) {
      throw core::UsageError(backup.string() + ": this is no backup (no folder objects in it)");
    }
  }
  std::map<ContentHash, std::vector<std::string>> owners;
  explaining(folder(), [&] {
    SQLite::Transaction snapshot(impl_->database);
    const auto note = [&](const std::vector<OwnedObject>& objects) {
      for (const OwnedObject& object : objects) owners[object.hash].push_back(object.owner);
    };
    for (const Scan& scan : scans()) note(objects_of_scan(impl_->database, scan.id));
    note(objects_of_no_scan(impl_->database));
  });
  std::vector<ContentHash> hashes;
  for (const auto& [hash, owner] : owners) hashes.push_back(hash);
  std::vector<std::optional<std::string>> problems(hashes.size());
  core::Progress progress("checking objects", hashes.size());
  core::parallel_for(hashes.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      core::throw_if_interrupted();
      problems[i] = impl_->objects.problem(hashes[i]);
      progress.advance();
    }
  });

  RepairReport report;
  // What interrupted writes left may be whole: its hash tells.
  std::optional<std::map<ContentHash, fs::path>> strangers;
  const auto left_over = [&](const ContentHash& hash) -> std::optional<fs::path> {
    if (!strangers) {
      strangers.emplace();
      for (const fs::path& file : impl_->objects.list().strangers) {
        try {
          strangers->emplace(hash_file(file), file);
        } catch (const core::StoreError&) {  // not readable: no copy
        }
      }
    }
    const auto found = strangers->find(hash);
    return found == strangers->end() ? std::nullopt : std::optional(found->second);
  };
  for (std::size_t i = 0; i < hashes.size(); ++i) {
    if (!problems[i]) continue;
    core::throw_if_interrupted();
    const ContentHash& hash = hashes[i];
    std::optional<fs::path> sound;
    for (const fs::path& backup : backups) {
      const ObjectFiles files(backup);
      if (!sound && !files.problem(hash)) sound = files.path(hash);
    }
    if (!sound) sound = left_over(hash);
    std::string blocked;
    if (sound && impl_->objects.is_blocked(hash)) {
      blocked = "; there is a sound copy, but no file can be put in its place (" + impl_->objects.path(hash).string() +
                "): move away what stands there";
      sound.reset();
    }
    if (sound) impl_->objects.adopt(*sound, hash);
    for (const std::string& owner : owners.at(hash)) {
      (sound ? report.mended : report.lost).push_back(owner + ": object " + hash.hex() + " " + *problems[i] + blocked);
    }
  }
  return report;
}

}  // namespace lightstage::db
