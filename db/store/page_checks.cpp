#include "db/store/page_checks.h"

#include <algorithm>
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
#include <vector>

#include <SQLiteCpp/Exception.h>
#include <SQLiteCpp/Statement.h>
#include <sqlite3.h>

#include "core/interrupt.h"
#include "db/store/bare_file.h"
#include "db/store/migrations.h"
#include "db/store/page_sum.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr const char* kLayer = "lightstage";
// Our own requests to the layer, beyond those that SQLite knows.
constexpr int kSetMode = 0x4c534331, kSetPageSize = 0x4c534332, kSetFirstPage = 0x4c534333;

// What becomes of a page that does not match: it is read and stays marked, reading it fails, it is put right or else reading it fails, or it is taken for sound.
enum class Mode { kMark, kRefuse, kMend, kAccept };

// Where a database's header says how large its pages are and how much of them is reserved.
constexpr std::size_t kHeaderBytes = 100, kPageSizeAt = 16, kReservedAt = 20;

// 0 for a header of pages without checksums.
std::size_t page_size_with_checks(const unsigned char* header) {
  const std::size_t size = std::size_t(header[kPageSizeAt]) << 8 | header[kPageSizeAt + 1];
  if (header[kReservedAt] != kPageSumBytes) return 0;
  return size == 1 ? 65536 : size;
}

// What is remembered of an open file.
struct Notes {
  std::set<std::uint64_t> marked;         // pages that did not match when they were read; when mending, those beyond it
  std::vector<unsigned char> first_page;  // read in place of the file's, where there is one
};

// SQLite's own layer keeps its file behind ours, in memory that SQLite gives for both.
struct File {
  sqlite3_file base;
  std::size_t page_size;  // 0 while the file is not known to have checksums
  Mode mode;
  Notes* notes;  // SQLite's memory cannot hold them
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

Notes& notes_of(File& file) {
  if (file.notes == nullptr) file.notes = std::make_unique<Notes>().release();
  return *file.notes;
}

int close(sqlite3_file* file) {
  const std::unique_ptr<Notes> notes(std::exchange(ours(file).notes, nullptr));
  return below(file)->pMethods->xClose(below(file));
}

// A page as it was read, which does not match.
int take_unsound(File& file, std::span<unsigned char> page, std::uint64_t number) {
  Notes& notes = notes_of(file);
  if (file.mode == Mode::kMend && !notes.marked.contains(number) && mend_page(page, number)) return SQLITE_OK;
  notes.marked.insert(number);
  return file.mode == Mode::kMark ? SQLITE_OK : SQLITE_IOERR_DATA;
}

int read(sqlite3_file* file, void* data, int length, sqlite3_int64 offset) {
  const std::span<unsigned char> bytes(static_cast<unsigned char*>(data), std::size_t(length));
  File& opened = ours(file);
  if (offset == 0 && opened.notes != nullptr && bytes.size() <= opened.notes->first_page.size()) {
    std::copy_n(opened.notes->first_page.begin(), bytes.size(), bytes.begin());
    return SQLITE_OK;
  }
  const int result = below(file)->pMethods->xRead(below(file), data, length, offset);
  if (result != SQLITE_OK) return result;
  if (offset == 0 && bytes.size() >= kHeaderBytes) opened.page_size = page_size_with_checks(bytes.data());
  const std::uint64_t number = page_number(opened, length, offset);
  if (number == 0 || opened.mode == Mode::kAccept || page_matches(bytes, number)) return SQLITE_OK;
  try {
    return take_unsound(opened, bytes, number);
  } catch (const std::bad_alloc&) {
    return SQLITE_IOERR_NOMEM;
  }
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
  auto sum = page_sum(page, number);
  if (ours(file).notes != nullptr && ours(file).notes->marked.contains(number)) {
    for (unsigned char& byte : sum) byte = static_cast<unsigned char>(~byte);
  }
  std::copy(sum.begin(), sum.end(), page.end() - kPageSumBytes);
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
  if (request == kSetFirstPage) {
    auto& page = *static_cast<std::vector<unsigned char>*>(argument);
    ours(file).page_size = page.size();
    notes_of(ours(file)).first_page = std::move(page);
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
  int bytes = int(kPageSumBytes);
  must(database, sqlite3_file_control(database.getHandle(), "main", SQLITE_FCNTL_RESERVE_BYTES, &bytes));
}

// The first page as it must have been, as far as can be told; empty for a file that is shorter than one.
std::vector<unsigned char> sound_first_page(const fs::path& path) {
  constexpr std::size_t kOurPageSize = 4096, kLargestPage = 65536;
  std::vector<unsigned char> begin(kLargestPage);
  begin.resize(BareFile(path).read(0, begin));
  if (begin.size() < kOurPageSize) return {};
  const auto begin_of = [&](std::size_t size) {
    return std::vector<unsigned char>(begin.begin(), begin.begin() + std::ptrdiff_t(size));
  };
  for (const std::size_t size : {page_size_with_checks(begin.data()), kOurPageSize}) {
    if (!std::has_single_bit(size) || size < 512 || size > begin.size()) continue;
    std::vector<unsigned char> page = begin_of(size);
    if (page_matches(page, 1) || mend_page(page, 1)) return page;
  }
  std::vector<unsigned char> page = begin_of(kOurPageSize);
  put_known_header(page, fs::file_size(path) / kOurPageSize);
  mend_page(page, 1);  // or as it is: what it must hold is seen by its schema
  return page;
}

std::optional<SQLite::Database> open_readable_pages(const fs::path& path, Mode mode) {
  std::error_code none;
  if (!fs::exists(path, none)) return std::nullopt;
  std::vector<unsigned char> first_page = sound_first_page(path);
  if (first_page.empty()) return std::nullopt;
  try {
    SQLite::Database database = open_checked(path, SQLite::OPEN_READWRITE);
    set_mode(database, mode);
    must(database, sqlite3_file_control(database.getHandle(), "main", kSetFirstPage, &first_page));
    database.exec("PRAGMA trusted_schema = OFF");
    if (schema_of(database) != current_schema()) return std::nullopt;
    return database;
  } catch (const SQLite::Exception&) {
    return std::nullopt;
  }
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
  return bytes == int(kPageSumBytes);
}

void renew_page_checks(SQLite::Database& database) {
  set_mode(database, Mode::kAccept);
  reserve(database);
  database.exec("VACUUM");
  set_mode(database, Mode::kMark);
}

std::optional<SQLite::Database> open_sound_pages(const fs::path& path) {
  return open_readable_pages(path, Mode::kRefuse);
}

std::optional<SQLite::Database> open_mended_pages(const fs::path& path) {
  return open_readable_pages(path, Mode::kMend);
}

std::vector<std::size_t> damaged_pages(const fs::path& catalogue) {
  BareFile file(catalogue);
  std::array<unsigned char, kHeaderBytes> header{};
  const std::size_t size = file.read(0, header) == kHeaderBytes ? page_size_with_checks(header.data()) : 0;
  if (size < 512 || !std::has_single_bit(size)) return {1};

  std::vector<unsigned char> page(size);
  const auto read_page = [&](std::size_t number) { return file.read((number - 1) * size, page) == size; };
  std::vector<std::size_t> damaged;
  for (std::size_t number = 1; read_page(number); ++number) {
    if (number % 1024 == 0) core::throw_if_interrupted();
    if (!page_matches(page, number)) damaged.push_back(number);
  }
  for (int look = 1; look < kLooks && !damaged.empty(); ++look) {
    std::this_thread::sleep_for(kBetweenLooks);
    std::erase_if(damaged, [&](std::size_t number) { return read_page(number) && page_matches(page, number); });
  }
  return damaged;
}

bool one_bit_flipped(const fs::path& catalogue, const std::vector<std::size_t>& pages) {
  std::vector<unsigned char> page = sound_first_page(catalogue);
  if (page.empty() || !page_matches(page, 1)) return false;
  BareFile file(catalogue);
  return std::ranges::all_of(pages, [&](std::size_t number) {
    if (number == 1) return true;
    core::throw_if_interrupted();
    return file.read((number - 1) * page.size(), page) == page.size() && mend_page(page, number);
  });
}

}  // namespace lightstage::db
