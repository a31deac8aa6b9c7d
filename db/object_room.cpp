#include "db/object_room.h"

namespace lightstage::db {

std::uintmax_t most_bytes(core::ImageSize size, std::size_t count) {
  // https://openexr.com/en/latest/OpenEXRFileLayout.html: a header, an offset of 8 bytes for each chunk, and before each chunk its row and size. Chunks
  // are of one row where nothing is compressed, of 16 by ZIP, which keeps what does not become smaller as it is.
  constexpr std::uintmax_t kHeader = 4096, kOfChunk = 16;
  constexpr std::uintmax_t kBlock = 4096;  // of the file system: files take whole ones
  constexpr std::uintmax_t kRow = 1024;    // of the catalogue, with its indices
  const std::uintmax_t file = kHeader + std::uintmax_t(size.height) * kOfChunk + 2 * std::uintmax_t(size.value_count());
  return count * ((file + kBlock - 1) / kBlock * kBlock + kRow);
}

}  // namespace lightstage::db
