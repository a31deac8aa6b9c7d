#include "db/scan_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>

#include "core/error.h"
#include "core/text.h"
#include "db/content_hash.h"
#include "db/store/store_folder.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

// Names of scans may be longer than those of files; one that names another folder is no scan's, and must not be followed there.
std::string file_name(std::string_view scan) {
  constexpr std::size_t kLongest = 200;
  const bool plain = !scan.starts_with('.') && scan.find('/') == std::string_view::npos;
  if (plain && !scan.empty() && scan.size() <= kLongest) return std::string(scan);
  return hash_bytes({reinterpret_cast<const unsigned char*>(scan.data()), scan.size()}).hex();
}

constexpr std::size_t kLongestText = 200;
constexpr std::string_view kWords = " is being ";  // behind the process's number

// What the file says, at most a letter more than a lock's would.
std::string text_of(int fd) {
  std::array<char, kLongestText + 1> text{};
  const ssize_t length = ::pread(fd, text.data(), text.size(), 0);
  return {text.data(), std::size_t(std::max<ssize_t>(0, length))};
}

// "1234 is being captured" in the file.
std::string who_holds(int fd) {
  const std::string line = text_of(fd);
  const std::size_t space = line.find(' ');
  const std::optional<std::int64_t> process = core::parse_integer(line.substr(0, space));
  // It may not have written it yet.
  if (!process || space == std::string::npos) return "is being worked on by another process";
  return line.substr(space + 1) + " by process " + std::to_string(*process);
}

// Whether the file is a lock, held before by somebody whose words may have been lost in part when the power failed: a number and words, nothing, or
// zeros. Anything else is somebody's own, and stays as it is.
bool is_lock(int fd, const struct stat& held) {
  if (!S_ISREG(held.st_mode) || held.st_nlink > 1 || held.st_size > off_t(kLongestText)) return false;
  const std::string text = text_of(fd);
  const std::size_t space = std::min(text.find(' '), text.size());
  const std::string begun = text.substr(space, kWords.size());
  const bool tells = core::parse_integer(text.substr(0, space)).value_or(0) > 0 && kWords.starts_with(begun);
  return tells || std::all_of(text.begin(), text.end(), [](char letter) { return letter == '\0'; });
}

}  // namespace

ScanLock::ScanLock(const fs::path& store_folder, std::string_view scan, std::string_view work)
    : name_(file_name(scan)), folder_(-1), file_(-1) {
  require_own_folders(store_folder);
  const fs::path locks = store_folder / "locks";
  const auto failure = [&](const std::string& problem) {
    const int error = errno;
    return core::StoreError(store_folder.string() + ": " + problem + ": " + std::strerror(error));
  };
  if (::mkdir(locks.c_str(), 0777) != 0 && errno != EEXIST) throw failure("cannot make a folder for locks");
  // All goes by this descriptor, whatever the folder's name comes to mean.
  folder_ = core::FileDescriptor(::open(locks.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!folder_.is_open()) throw failure("the folder locks cannot be opened");
  struct stat held {
  }, named{};
  do {
    file_ = core::FileDescriptor(
        ::openat(folder_.get(), name_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666));
    if (!file_.is_open()) throw failure("cannot lock scan '" + std::string(scan) + "'");
    int result = 0;
    do {
      result = ::flock(file_.get(), LOCK_EX | LOCK_NB);
    } while (result != 0 && errno == EINTR);
    if (result != 0 && errno == EWOULDBLOCK) {
      throw core::StoreError(store_folder.string() + ": scan '" + std::string(scan) + "' " + who_holds(file_.get()) +
                             "; wait until that ends, or end it");
    }
    if (::fstat(file_.get(), &held) != 0) throw failure("cannot lock scan '" + std::string(scan) + "'");
    // The holder before removed the file at its end, perhaps just before this one had its lock: then it locks nothing.
  } while (::fstatat(folder_.get(), name_.c_str(), &named, AT_SYMLINK_NOFOLLOW) != 0 || named.st_dev != held.st_dev ||
           named.st_ino != held.st_ino);
  if (!is_lock(file_.get(), held)) {
    throw core::StoreError((locks / name_).string() +
                           ": is no lock of a scan, and stands where one belongs; move it away (it was not touched)");
  }
  const std::string text = std::to_string(::getpid()) + " " + std::string(work);
  // Only to tell others: on a full disk it is a lock without that.
  if (::ftruncate(file_.get(), 0) != 0 || ::pwrite(file_.get(), text.data(), text.size(), 0) < 0) return;
}

ScanLock::~ScanLock() {
  ::unlinkat(folder_.get(), name_.c_str(), 0);
}

}  // namespace lightstage::db
