#include "model/engine/encoding_cache.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/file.h"

namespace lightstage::model {
namespace {

bool write_all(int file, const std::byte* data, std::size_t bytes, std::size_t offset) {
  while (bytes > 0) {
    const ssize_t written = ::pwrite(file, data, bytes, static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    data += written;
    bytes -= static_cast<std::size_t>(written);
    offset += static_cast<std::size_t>(written);
  }
  return true;
}

}  // namespace

SpillFile::SpillFile(const std::filesystem::path& folder) {
  std::string name = (folder / "lightstage-XXXXXX").string();
  file_ = ::mkostemp(name.data(), O_CLOEXEC);
  if (file_ < 0) {
    throw core::BadInput(folder.string() + ": no file can be made here for encodings (" + std::strerror(errno) +
                         "): set TMPDIR to a folder that takes files");
  }
  ::unlink(name.c_str());
}

SpillFile::~SpillFile() {
  ::close(file_);
}

std::optional<std::size_t> SpillFile::append(const FeatureMap& map) {
  if (!write_all(file_, map.data(), map.bytes(), end_)) return std::nullopt;
  const std::size_t page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  return std::exchange(end_, (end_ + map.bytes() + page - 1) / page * page);
}

FeatureMap SpillFile::map(const FeatureMap& shape, std::size_t offset) const {
  return {shape, Pages(file_, offset, shape.bytes())};
}

EncodingCache::Pointer EncodingCache::find(std::size_t light) {
  const std::lock_guard lock(mutex_);
  if (const auto spilled = spilled_.find(light); spilled != spilled_.end()) {
    auto encoding = std::make_shared<Encoding>();
    for (const SpilledLevel& level : spilled->second) {
      encoding->levels.push_back(file_->map(level.shape, level.offset));
    }
    return encoding;
  }
  const auto slot = in_memory_.find(light);
  if (slot == in_memory_.end()) return nullptr;
  recently_used_.splice(recently_used_.begin(), recently_used_, slot->second.place);
  return slot->second.encoding;
}

void EncodingCache::keep(std::size_t light, const Pointer& encoding) {
  const std::lock_guard lock(mutex_);
  if (in_memory_.contains(light) || spilled_.contains(light)) return;
  const std::size_t bytes = encoding->bytes();
  if (memory_used_ + bytes > budget_.memory_bytes) {
    if (spill(light, *encoding)) return;
    if (bytes > budget_.memory_bytes) return;
    while (memory_used_ + bytes > budget_.memory_bytes) {
      const auto oldest = in_memory_.find(recently_used_.back());
      memory_used_ -= oldest->second.encoding->bytes();
      in_memory_.erase(oldest);
      recently_used_.pop_back();
    }
  }
  recently_used_.push_front(light);
  in_memory_[light] = {encoding, recently_used_.begin()};
  memory_used_ += bytes;
}

bool EncodingCache::spill(std::size_t light, const Encoding& encoding) {
  if (spill_used_ + encoding.bytes() > budget_.spill_bytes) return false;
  if (file_ == nullptr) {
    file_ = std::make_unique<SpillFile>(budget_.spill_folder.empty() ? core::temporary_folder() : budget_.spill_folder);
  }
  std::vector<SpilledLevel> levels;
  for (const FeatureMap& level : encoding.levels) {
    const std::optional<std::size_t> offset = file_->append(level);
    if (!offset) {
      spill_used_ = budget_.spill_bytes;  // the disk is full: no more of it
      return false;
    }
    levels.push_back({FeatureMap(level, Pages()), *offset});
  }
  spill_used_ += encoding.bytes();
  spilled_[light] = std::move(levels);
  return true;
}

}  // namespace lightstage::model
