#include "capture/v4l2/video_system.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <optional>

#include "core/text.h"

namespace lightstage::capture {

namespace {

namespace fs = std::filesystem;

// Attributes of sysfs are one short line.
std::string attribute(const fs::path& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return std::string(core::trim(line));
}

class KernelVideoSystem : public VideoSystem {
 public:
  std::vector<VideoNode> nodes() override {
    std::vector<std::pair<std::int64_t, VideoNode>> numbered;
    std::error_code no_folder;
    for (const fs::directory_entry& entry : fs::directory_iterator("/sys/class/video4linux", no_folder)) {
      const std::string name = entry.path().filename().string();
      constexpr std::string_view kPrefix = "video";
      if (!name.starts_with(kPrefix)) continue;
      const std::optional<std::int64_t> number = core::parse_integer(std::string_view(name).substr(kPrefix.size()));
      if (!number) continue;
      VideoNode node;
      node.path = "/dev/" + name;
      node.card = attribute(entry.path() / "name");
      // `device` is the USB interface; the device above it has the serial number.
      node.serial = attribute(entry.path() / "device" / ".." / "serial");
      node.index = static_cast<int>(core::parse_integer(attribute(entry.path() / "index")).value_or(0));
      numbered.emplace_back(*number, std::move(node));
    }
    std::sort(numbered.begin(), numbered.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<VideoNode> nodes;
    for (auto& [number, node] : numbered) nodes.push_back(std::move(node));
    return nodes;
  }

  int open(const std::string& path, int& descriptor) override {
    do {
      descriptor = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
    } while (descriptor < 0 && errno == EINTR);
    return descriptor < 0 ? errno : 0;
  }

  void close(int descriptor) override { ::close(descriptor); }

  int ioctl(int descriptor, unsigned long request, void* argument) override {
    int result;
    do {
      result = ::ioctl(descriptor, request, argument);
    } while (result < 0 && errno == EINTR);
    return result < 0 ? errno : 0;
  }

  int poll(int descriptor, core::Nanoseconds timeout, short& events) override {
    timeout = std::clamp<core::Nanoseconds>(timeout, 0, 3600 * core::kSecond);
    const timespec time{timeout / core::kSecond, timeout % core::kSecond};
    pollfd waiting{descriptor, POLLIN, 0};
    const int result = ::ppoll(&waiting, 1, &time, nullptr);
    events = result > 0 ? waiting.revents : short(0);
    return result < 0 && errno != EINTR ? errno : 0;
  }

  int map(int descriptor, std::size_t length, std::int64_t offset, std::byte*& address) override {
    void* const mapped = ::mmap(nullptr, length, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, offset);
    if (mapped == MAP_FAILED) return errno;
    address = static_cast<std::byte*>(mapped);
    return 0;
  }

  void unmap(std::byte* address, std::size_t length) override { ::munmap(address, length); }
};

}  // namespace

VideoSystem& kernel_video_system() {
  static KernelVideoSystem system;
  return system;
}

}  // namespace lightstage::capture
