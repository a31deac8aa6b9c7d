#include "db/store/lock_holders.h"

#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <limits>
#include <set>
#include <sstream>
#include <vector>

#include "core/text.h"
#include "db/store/catalogue.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

// https://www.sqlite.org/walformat.html, section 2.3: whoever writes holds byte 120 of the -shm file, whoever copies the log into the database byte 121.
constexpr long kFirstWriterByte = 120, kLastWriterByte = 121;
constexpr std::size_t kMostCommandLetters = 100;

// proc(5): its arguments, each ended by a zero.
std::string command_of(long pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/cmdline", std::ios::binary);
  std::string words;
  for (char c; words.size() < kMostCommandLetters && file.get(c);) {
    words += c == '\0' ? ' ' : (static_cast<unsigned char>(c) < 0x20 || c == 0x7F ? '?' : c);
  }
  return std::string(core::trim(words));
}

// Who has locked the file, as `wanted(kind of lock, first byte, last byte)` asks.
template <class Wanted>
std::string holders_of(const fs::path& path, const Wanted& wanted) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return {};
  char file[64];
  std::snprintf(file, sizeof file, "%02x:%02x:%lu", major(status.st_dev), minor(status.st_dev),
                static_cast<unsigned long>(status.st_ino));
  std::set<long> pids;
  std::ifstream locks("/proc/locks");
  for (std::string line; std::getline(locks, line);) {
    // "12: POSIX  ADVISORY  WRITE 4711 fe:00:393228 120 120"; those that wait have an arrow before their kind.
    std::istringstream words(line);
    std::string number, kind, strength, access, place, last;
    long pid = 0, first = 0;
    if (!(words >> number >> kind >> strength >> access >> pid >> place >> first >> last)) continue;
    if (access != "WRITE" || place != file) continue;
    constexpr long kEnd = std::numeric_limits<long>::max();
    if (wanted(kind, first, last == "EOF" ? kEnd : long(core::parse_integer(last).value_or(0)))) pids.insert(pid);
  }
  std::vector<std::string> holders;
  for (const long pid : pids) {
    const std::string command = command_of(pid);
    holders.push_back(pid == ::getpid()
                          ? "this program itself"
                          : "process " + std::to_string(pid) + (command.empty() ? "" : " (" + command + ")"));
  }
  return core::joined(holders, ", ");
}

}  // namespace

std::string lock_holders(const fs::path& store_folder) {
  return holders_of(catalogue_path(store_folder).string() + "-shm", [](const std::string&, long first, long last) {
    return first <= kLastWriterByte && last >= kFirstWriterByte;
  });
}

std::string folder_lock_holders(const fs::path& folder) {
  return holders_of(folder, [](const std::string& kind, long, long) { return kind == "FLOCK"; });
}

}  // namespace lightstage::db
