// How the shim writes down what a program does to files: headers, each followed by path, second path and data.
#pragma once

#include <cstdint>

namespace lightstage::fault {

enum class RecordKind : std::uint32_t { kCreate, kWrite, kTruncate, kSync, kRename, kRemove, kMakeFolder };

struct RecordHeader {
  std::uint32_t kind = 0;
  std::uint32_t path_length = 0;
  std::uint32_t to_length = 0;  // of kRename
  std::uint32_t unused = 0;
  std::uint64_t offset = 0;  // of kWrite; the size of kTruncate
  std::uint64_t data_length = 0;
};

}  // namespace lightstage::fault
