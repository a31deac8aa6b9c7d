// Keeps encodings between queries: in memory first, then in a file.
#pragma once

#include <cstddef>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "model/engine/encoder.h"

namespace lightstage::model {

// A file without a name, gone with the process however it ends. Throws core::Error where the folder takes no files.
class SpillFile {
 public:
  explicit SpillFile(const std::filesystem::path& folder);
  ~SpillFile();
  SpillFile(const SpillFile&) = delete;
  SpillFile& operator=(const SpillFile&) = delete;

  // Where the map was written; nothing where the disk is full.
  std::optional<std::size_t> append(const FeatureMap& map);
  // The map of this shape written there, as memory that the file backs: resident only while it is held.
  FeatureMap map(const FeatureMap& shape, std::size_t offset) const;

 private:
  int file_;
  std::size_t end_ = 0;
};

struct EncodingBudget {
  std::size_t memory_bytes = std::size_t(2) << 30;
  std::size_t spill_bytes = 0;
  std::filesystem::path spill_folder = {};  // empty: the system's folder for temporary files
};

// May be used from several threads. All encodings are of one size.
class EncodingCache {
 public:
  using Pointer = std::shared_ptr<const Encoding>;

  explicit EncodingCache(const EncodingBudget& budget) : budget_(budget) {}

  // Null where it is not kept.
  Pointer find(std::size_t light);
  // Keeps it in memory; where that is full, in the file; where that is full too, in the place of the one in memory that was used least
  // recently. Larger than all: not at all. Throws BadInput when there is something to put into the file and no folder that takes one.
  void keep(std::size_t light, const Pointer& encoding);

 private:
  struct Slot {
    Pointer encoding;
    std::list<std::size_t>::iterator place;
  };
  bool spill(std::size_t light, const Encoding& encoding);

  const EncodingBudget budget_;
  std::mutex mutex_;
  std::size_t memory_used_ = 0, spill_used_ = 0;
  std::map<std::size_t, Slot> in_memory_;
  std::list<std::size_t> recently_used_;  // of those in memory, most recent first
  struct SpilledLevel {
    FeatureMap shape;
    std::size_t offset;
  };
  std::map<std::size_t, std::vector<SpilledLevel>> spilled_;
  std::unique_ptr<SpillFile> file_;
};

}  // namespace lightstage::model
