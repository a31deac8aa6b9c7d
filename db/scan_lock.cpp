#include "db/scan_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <optional>

#include "core/error.h"
#include "core/text.h"
#include "db/content_hash.h"

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

bool names(const fs::path& path, int fd) {
  struct stat named {
  }, held{};
  return ::stat(path.c_str(), &named) == 0 && ::fstat(fd, &held) == 0 && named.st_dev == held.st_dev &&
         named.st_ino == held.st_ino;
}

// "1234 is being captured" in the file.
std::string who_holds(int fd) {
  std::array<char, 200> text{};
  const ssize_t length = ::pread(fd, text.data(), text.size(), 0);
  const std::string_view line(text.data(), std::size_t(std::max<ssize_t>(0, length)));
  const std::size_t space = line.find(' ');
  const std::optional<std::int64_t> process = core::parse_integer(line.substr(0, space));
  // It may not have written it yet.
  if (!process || space == std::string_view::npos) return "is being worked on by another process";
  return std::string(line.substr(space + 1)) + " by process " + std::to_string(*process);
}

}  // namespace

ScanLock::ScanLock(const fs::path& store_folder, std::string_view scan, std::string_view work)
    : path_(store_folder / "locks" / file_name(scan)) {
  const auto fail = [&](const std::string& problem) {
    const int error = errno;
    if (fd_ >= 0) ::close(fd_);
    throw core::StoreError(store_folder.string() + ": " + problem + ": " + std::strerror(error));
  };
  if (::mkdir(path_.parent_path().c_str(), 0777) != 0 && errno != EEXIST) fail("cannot make a folder for locks");
  while (true) {
    fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (fd_ < 0) fail("cannot lock scan '" + std::string(scan) + "'");
    int result = 0;
    do {
      result = ::flock(fd_, LOCK_EX | LOCK_NB);
    } while (result != 0 && errno == EINTR);
    if (result != 0 && errno == EWOULDBLOCK) {
      const std::string holder = who_holds(fd_);
      ::close(fd_);
      throw core::StoreError(store_folder.string() + ": scan '" + std::string(scan) + "' " + holder +
                             "; wait until that ends, or end it");
    }
    // The holder before removed the file at its end, perhaps just before this one had its lock: then it locks nothing.
    if (names(path_, fd_)) break;
    ::close(fd_);
  }
  const std::string text = std::to_string(::getpid()) + " " + std::string(work);
  // Only to tell others: on a full disk it is a lock without that.
  if (::ftruncate(fd_, 0) != 0 || ::pwrite(fd_, text.data(), text.size(), 0) < 0) return;
}

ScanLock::~ScanLock() {
  ::unlink(path_.c_str());
  ::close(fd_);
}

}  // namespace lightstage::db
