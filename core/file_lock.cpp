#include "core/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "core/error.h"

namespace lightstage::core {

FileLock::FileLock(const std::filesystem::path& path, bool wait) : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (fd_ < 0) throw BadInput("cannot open " + path.string() + ": " + std::strerror(errno));
  int result = 0;
  do {
    result = ::flock(fd_, LOCK_EX | (wait ? 0 : LOCK_NB));
  } while (result != 0 && errno == EINTR);
  held_ = result == 0 || errno != EWOULDBLOCK;
}

FileLock::FileLock(const std::filesystem::path& path) : FileLock(path, true) {}

std::optional<FileLock> FileLock::try_lock(const std::filesystem::path& path) {
  FileLock lock(path, false);
  if (!lock.held_) return std::nullopt;
  return lock;
}

FileLock::FileLock(FileLock&& other) noexcept : fd_(std::exchange(other.fd_, -1)), held_(other.held_) {}

FileLock::~FileLock() {
  if (fd_ >= 0) ::close(fd_);
}

}  // namespace lightstage::core
