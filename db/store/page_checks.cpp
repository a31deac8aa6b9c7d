#include "db/store/page_checks.h"

#include <array>
#include <bit>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>

#include <SQLiteCpp/Exception.h>
#include <SQLiteCpp/Statement.h>
#include <sqlite3.h>
#include <xxhash.h>

#include "core/interrupt.h"
#include "db/store/bare_file.h"
#include "db/store/migrations.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr const char* kLayer = "lightstage";
constexpr int kCheckBytes = 8;
// Our own requests to the layer, beyond those that SQLite knows.
constexpr int kSetMode = 0x4c534331, kSetPageSize = 0x4c534332;

// What becomes of a page that does not match: it is read and stays marked, reading it fails, or it is taken for sound.
enum class Mode { kMark, kRefuse, kAccept };

// Where a database's header says how large its pages are and how much of them is reserved.
constexpr std::size_t kHeaderBytes = 100, kPageSizeAt = 16, kReservedAt = 20;

// 0 for a header of pages without checksums.
std::size_t page_size_with_checks(const unsigned char* header) {
  const std::size_t size = std::size_t(header[kPageSizeAt]) << 8 | header[kPageSizeAt + 1];
  if (header[kReservedAt] != kCheckBytes) return 0;
  return size == 1 ? 65536 : size;
}

std::array<unsigned char, kCheckBytes> check_of(const unsigned char* page, std::size_t size, std::uint64_t number) {
  XXH64_canonical_t canonical;
  XXH64_canonicalFromHash(&canonical, XXH3_64bits_withSeed(page, size - kCheckBytes, number));
  return std::to_array(canonical.digest);
}

bool matches(const unsigned char* page, std::size_t size, std::uint64_t number) {
  return std::memcmp(check_of(page, size, number).data(), page + size - kCheckBytes, kCheckBytes) == 0;
}

// SQLite's own layer keeps its file behind ours, in memory that SQLite gives for both.
struct File {
  sqlite3_file base;
  std::size_t page_size;  // 0 while the file is not known to have checksums
  Mode mode;
  std::set<std::uint64_t>*
      marked;  // pages that did not match when they were read; SQLite's memory cannot hold the set itself
  sqlite3_file* below() { return reinterpret_cast<sqlite3_file*>(this + 1); }
};

File& ours(sqlite3_file* file) {
  return *reinterpret_cast<File*>(file);
}
sqlite3_file* below(sqlite3_file* file) {
  return ours(file).below();
}

sqlite3_vfs* system_layer() {
  return sqlite3_vfs_find(nullptr);
}

// Nonzero page number when the block is one whole page of a file with checksums.
std::uint64_t page_number(const File& file, int length, sqlite3_int64 offset) {
  if (file.page_size == 0 || std::size_t(length) != file.page_size || offset % length != 0) return 0;
  return std::uint64_t(offset / length) + 1;
}

int close(sqlite3_file* file) {
  const std::unique_ptr<std::set<std::uint64_t>> marked(std::exchange(ours(file).marked, nullptr));
  return below(file)->pMethods->xClose(below(file));
}

int read(sqlite3_file* file, void* data, int length, sqlite3_int64 offset) {
  const int result = below(file)->pMethods->xRead(below(file), data, length, offset);
  if (result != SQLITE_OK) return result;
  const auto* bytes = static_cast<const unsigned char*>(data);
  if (offset == 0 && std::size_t(length) >= kHeaderBytes) ours(file).page_size = page_size_with_checks(bytes);
  const std::uint64_t number = page_number(ours(file), length, offset);
  if (number == 0 || ours(file).mode == Mode::kAccept || matches(bytes, std::size_t(length), number)) return SQLITE_OK;
  if (ours(file).mode == Mode::kRefuse) return SQLITE_IOERR_DATA;
  try {
    if (ours(file).marked == nullptr) ours(file).marked = std::make_unique<std::set<std::uint64_t>>().release();
    ours(file).marked->insert(number);
  } catch (const std::bad_alloc&) {
    return SQLITE_IOERR_NOMEM;
  }
  return SQLITE_OK;
}

int write(sqlite3_file* file, const void* data, int length, sqlite3_int64 offset) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  if (offset == 0 && std::size_t(length) >= kHeaderBytes) ours(file).page_size = page_size_with_checks(bytes);
  const std::uint64_t number = page_number(ours(file), length, offset);
  if (number == 0) return below(file)->pMethods->xWrite(below(file), data, length, offset);
  // SQLite's memory is not ours to write to: the page goes by a copy.
  thread_local std::vector<unsigned char> page;
  try {
    page.assign(bytes, bytes + length);
  } catch (const std::bad_alloc&) {
    return SQLITE_IOERR_NOMEM;
  }
  auto check = check_of(bytes, std::size_t(length), number);
  if (ours(file).marked != nullptr && ours(file).marked->contains(number)) {
    for (unsigned char& byte : check) byte = static_cast<unsigned char>(~byte);
  }
  std::copy(check.begin(), check.end(), page.end() - kCheckBytes);
  return below(file)->pMethods->xWrite(below(file), page.data(), length, offset);
}

int control(sqlite3_file* file, int request, void* argument) {
  if (request == kSetMode) {
    ours(file).mode = *static_cast<const Mode*>(argument);
    return SQLITE_OK;
  }
  if (request == kSetPageSize) {
    ours(file).page_size = *static_cast<const std::size_t*>(argument);
    return SQLITE_OK;
  }
  if (request == SQLITE_FCNTL_CKPT_START) {
    // Another program may have added the checksums since.
    std::array<unsigned char, kHeaderBytes> header{};
    if (below(file)->pMethods->xRead(below(file), header.data(), int(header.size()), 0) == SQLITE_OK) {
      ours(file).page_size = page_size_with_checks(header.data());
    }
  }
  return below(file)->pMethods->xFileControl(below(file), request, argument);
}

// Pages that are mapped into memory would be read past the layer.
int fetch(sqlite3_file*, sqlite3_int64, int, void** page) {
  *page = nullptr;
  return SQLITE_OK;
}
int unfetch(sqlite3_file*, sqlite3_int64, void*) {
  return SQLITE_OK;
}

const sqlite3_io_methods kMethods = {
    3,
    close,
    read,
    write,
    [](sqlite3_file* file, sqlite3_int64 size) { return below(file)->pMethods->xTruncate(below(file), size); },
    [](sqlite3_file* file, int flags) { return below(file)->pMethods->xSync(below(file), flags); },
    [](sqlite3_file* file, sqlite3_int64* size) { return below(file)->pMethods->xFileSize(below(file), size); },
    [](sqlite3_file* file, int level) { return below(file)->pMethods->xLock(below(file), level); },
    [](sqlite3_file* file, int level) { return below(file)->pMethods->xUnlock(below(file), level); },
    [](sqlite3_file* file, int* held) { return below(file)->pMethods->xCheckReservedLock(below(file), held); },
    control,
    [](sqlite3_file* file) { return below(file)->pMethods->xSectorSize(below(file)); },
    [](sqlite3_file* file) { return below(file)->pMethods->xDeviceCharacteristics(below(file)); },
    [](sqlite3_file* file, int region, int size, int extend, void volatile** memory) {
      return below(file)->pMethods->xShmMap(below(file), region, size, extend, memory);
    },
    [](sqlite3_file* file, int offset, int count, int flags) {
      return below(file)->pMethods->xShmLock(below(file), offset, count, flags);
    },
    [](sqlite3_file* file) { below(file)->pMethods->xShmBarrier(below(file)); },
    [](sqlite3_file* file, int remove) { return below(file)->pMethods->xShmUnmap(below(file), remove); },
    fetch,
    unfetch,
};

int open(sqlite3_vfs*, sqlite3_filename name, sqlite3_file* file, int flags, int* out_flags) {
  sqlite3_vfs* system = system_layer();
  // Journals, logs and temporary files go past the layer: they are read back by SQLite's own rules.
  if ((flags & SQLITE_OPEN_MAIN_DB) == 0) return system->xOpen(system, name, file, flags, out_flags);
  File& opened = ours(file);
  opened = {};
  const int result = system->xOpen(system, name, opened.below(), flags, out_flags);
  // Of a file that could not be opened SQLite closes what has methods.
  if (opened.below()->pMethods != nullptr) opened.base.pMethods = &kMethods;
  return result;
}

// Everything but the opening of files is the system's own affair.
const char* layer() {
  static const bool registered = [] {
    static sqlite3_vfs vfs = *system_layer();
    vfs.zName = kLayer;
    vfs.szOsFile += int(sizeof(File));
    vfs.pNext = nullptr;
    vfs.xOpen = open;
    return sqlite3_vfs_register(&vfs, 0) == SQLITE_OK;
  }();
  return registered ? kLayer : nullptr;
}

void must(const SQLite::Database& database, int result) {
  if (result != SQLITE_OK) throw SQLite::Exception(database.getHandle(), result);
}

void set_mode(SQLite::Database& database, Mode mode) {
  must(database, sqlite3_file_control(database.getHandle(), "main", kSetMode, &mode));
}

void reserve(SQLite::Database& database) {
  int bytes = kCheckBytes;
  must(database, sqlite3_file_control(database.getHandle(), "main", SQLITE_FCNTL_RESERVE_BYTES, &bytes));
}

}  // namespace

SQLite::Database open_checked(const fs::path& path, int flags, int busy_timeout_ms) {
  SQLite::Database database(path.string(), flags, busy_timeout_ms, layer());
  std::error_code none;
  if ((flags & SQLite::OPEN_CREATE) != 0 && fs::file_size(path, none) == 0) {
    reserve(database);
    // SQLite may write other pages before the first, whose header would say so.
    std::size_t page_size = std::size_t(database.execAndGet("PRAGMA page_size").getInt());
    must(database, sqlite3_file_control(database.getHandle(), "main", kSetPageSize, &page_size));
  }
  return database;
}

bool has_page_checks(const SQLite::Database& database) {
  int bytes = -1;  // asks
  must(database, sqlite3_file_control(database.getHandle(), "main", SQLITE_FCNTL_RESERVE_BYTES, &bytes));
  return bytes == kCheckBytes;
}

void renew_page_checks(SQLite::Database& database) {
  set_mode(database, Mode::kAccept);
  reserve(database);
  database.exec("VACUUM");
  set_mode(database, Mode::kMark);
}

std::optional<SQLite::Database> open_sound_pages(const fs::path& path) {
  std::error_code none;
  if (!fs::exists(path, none)) return std::nullopt;
  try {
    SQLite::Database database = open_checked(path, SQLite::OPEN_READWRITE);
    database.exec("PRAGMA trusted_schema = OFF");
    set_mode(database, Mode::kAccept);
    if (schema_of(database) != current_schema()) return std::nullopt;
    set_mode(database, Mode::kRefuse);
    return database;
  } catch (const SQLite::Exception&) {
    return std::nullopt;
  }
}

std::vector<std::size_t> damaged_pages(const fs::path& catalogue) {
  BareFile file(catalogue);
  std::array<unsigned char, kHeaderBytes> header{};
  const std::size_t size = file.read(0, header) == kHeaderBytes ? page_size_with_checks(header.data()) : 0;
  if (size < 512 || !std::has_single_bit(size)) return {1};

  constexpr int kLooks = 20;
  constexpr std::chrono::milliseconds kBetweenLooks{10};
  std::vector<unsigned char> page(size);
  const auto read_page = [&](std::size_t number) { return file.read((number - 1) * size, page) == size; };
  std::vector<std::size_t> damaged;
  for (std::size_t number = 1;; ++number) {
    if (number % 1024 == 0) core::throw_if_interrupted();
    if (!read_page(number)) break;
    if (matches(page.data(), size, number)) continue;
    bool sound = false;
    for (int look = 1; look < kLooks && !sound; ++look) {
      std::this_thread::sleep_for(kBetweenLooks);
      sound = read_page(number) && matches(page.data(), size, number);
    }
    if (!sound) damaged.push_back(number);
  }
  return damaged;
}

}  // namespace lightstage::db
