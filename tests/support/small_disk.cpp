#include "support/small_disk.h"

#include <fcntl.h>
#include <sched.h>
#include <sys/mount.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

namespace lightstage::test {

namespace fs = std::filesystem;

SmallDisk::SmallDisk(const fs::path& folder, std::size_t megabytes) : folder_(folder) {
  const std::string size = "size=" + std::to_string(megabytes) + "m";
  // In a mount namespace of its own, whose mounts no other process sees.
  const bool mounted = ::unshare(CLONE_NEWNS) == 0 &&
                       ::mount("none", "/", "none", MS_REC | MS_PRIVATE, nullptr) == 0 &&
                       ::mount("tmpfs", folder.c_str(), "tmpfs", 0, size.c_str()) == 0;
  if (!mounted) problem_ = std::string("cannot mount a small disk: ") + std::strerror(errno);
}

SmallDisk::~SmallDisk() {
  if (problem_.empty()) ::umount2(folder_.c_str(), MNT_DETACH);
}

bool SmallDisk::make_read_only() const {
  return ::mount("tmpfs", folder_.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, nullptr) == 0;
}

void SmallDisk::fill(const std::string& name, std::size_t bytes_left) const {
  const int fd = ::open((folder_ / name).c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  const std::vector<char> block(4096, 'x');
  while (fd >= 0 && fs::space(folder_).available > bytes_left && ::write(fd, block.data(), block.size()) > 0) {
  }
  if (fd >= 0) ::close(fd);
}

}  // namespace lightstage::test
