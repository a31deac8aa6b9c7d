#include "core/unsynced_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "core/error.h"
#include "core/file.h"
#include "core/sync_folder.h"

namespace lightstage::core {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kMostWaiting = 16;              // threads that wait for the disk at a time
constexpr std::size_t kLarge = std::size_t(1) << 20;  // bytes, from which on the system's cache is bypassed
constexpr std::size_t kBlock = 4096;                  // that every disk takes
constexpr std::size_t kBuffer = std::size_t(4) << 20;

BadInput system_failure(const std::string& action, const fs::path& path) {
  return BadInput(action + " " + path.string() + ": " + std::strerror(errno));
}

// False with errno when the disk fails.
bool write_through_cache(int descriptor, std::span<const unsigned char> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(descriptor, bytes.data(), bytes.size());
    if (n < 0 && errno != EINTR) return false;
    if (n > 0) bytes = bytes.subspan(std::size_t(n));
  }
  return true;
}

// Whether what is written from now on goes straight to the disk. Many file systems cannot.
bool bypass_cache(int descriptor, bool bypass) {
#ifdef O_DIRECT
  const int flags = ::fcntl(descriptor, F_GETFL);
  return flags >= 0 && ::fcntl(descriptor, F_SETFL, bypass ? flags | O_DIRECT : flags & ~O_DIRECT) == 0;
#else
  return !bypass;
#endif
}

// Straight to the disk, as far as there are whole blocks: pages of the system's cache take more of the processor than all the rest of keeping a
// picture, and push out what others read. Returns how many bytes that were; less where the file system does not take it.
std::size_t write_directly(int descriptor, std::span<const unsigned char> bytes) {
  struct Free {
    void operator()(void* memory) const { std::free(memory); }
  };
  thread_local const std::unique_ptr<unsigned char, Free> buffer(
      static_cast<unsigned char*>(std::aligned_alloc(kBlock, kBuffer)));
  if (buffer == nullptr || !bypass_cache(descriptor, true)) return 0;
  std::size_t done = 0;
  while (bytes.size() - done >= kBlock) {
    const std::size_t size = std::min(kBuffer, (bytes.size() - done) / kBlock * kBlock);
    std::memcpy(buffer.get(), bytes.data() + done, size);
    const ssize_t n = ::write(descriptor, buffer.get(), size);
    if (n < 0 && errno == EINTR) continue;
    if (n > 0) done += std::size_t(n);
    if (n != ssize_t(size)) break;  // a failure that lasts shows when the rest is written
  }
  bypass_cache(descriptor, false);
  return done;
}

bool write_all(int descriptor, std::span<const unsigned char> bytes) {
  const std::size_t done = bytes.size() >= kLarge ? write_directly(descriptor, bytes) : 0;
  return write_through_cache(descriptor, bytes.subspan(done));
}

// Calls work(i) for every i below count, many at a time; waiting takes no processor, so there may be more threads than processors. Throws what
// the first failure threw, after all have ended.
void wait_for_all(std::size_t count, const std::function<void(std::size_t)>& work) {
  std::atomic<std::size_t> next = 0;
  std::mutex mutex;
  std::exception_ptr failure;
  const auto run = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        work(i);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!failure) failure = std::current_exception();
      }
    }
  };
  std::vector<std::thread> helpers;
  try {
    while (helpers.size() + 1 < std::min(count, kMostWaiting)) helpers.emplace_back(run);
  } catch (const std::system_error&) {  // no more threads to be had: those there are do it
  }
  run();
  for (std::thread& helper : helpers) helper.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace

UnsyncedFile::UnsyncedFile(fs::path target, std::span<const unsigned char> bytes) : target_(std::move(target)) {
  fs::path temporary = file_detail::temporary_beside(target_);
  descriptor_ = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor_ < 0) throw system_failure("cannot write", target_);
  temporary_ = std::move(temporary);
  if (!write_all(descriptor_, bytes)) {
    const BadInput failure = system_failure("cannot write", target_);
    discard();
    throw failure;
  }
#ifdef SYNC_FILE_RANGE_WRITE
  // The disk begins now and not when it is waited for. Only a hint: where it fails, the sync does all.
  ::sync_file_range(descriptor_, 0, 0, SYNC_FILE_RANGE_WRITE);
#endif
}

UnsyncedFile::UnsyncedFile(UnsyncedFile&& other) noexcept
    : target_(std::move(other.target_)),
      temporary_(std::exchange(other.temporary_, {})),
      descriptor_(std::exchange(other.descriptor_, -1)) {}

UnsyncedFile& UnsyncedFile::operator=(UnsyncedFile&& other) noexcept {
  std::swap(target_, other.target_);
  std::swap(temporary_, other.temporary_);
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

UnsyncedFile::~UnsyncedFile() {
  discard();
}

void UnsyncedFile::discard() noexcept {
  if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
  if (!temporary_.empty()) file_detail::discard(temporary_);
  temporary_.clear();
}

void UnsyncedFile::sync() {
  if (::fsync(descriptor_) != 0 || ::close(std::exchange(descriptor_, -1)) != 0)
    throw system_failure("cannot write", target_);
}

void UnsyncedFile::move_to_target() {
  if (std::rename(temporary_.c_str(), target_.c_str()) != 0) throw system_failure("cannot write", target_);
  temporary_.clear();
}

void UnsyncedFile::keep(std::span<UnsyncedFile* const> files) {
  wait_for_all(files.size(), [&](std::size_t i) { files[i]->sync(); });
  std::vector<fs::path> folders;
  for (UnsyncedFile* file : files) {
    file->move_to_target();
    folders.push_back(file->target_.parent_path());
  }
  std::sort(folders.begin(), folders.end());
  folders.erase(std::unique(folders.begin(), folders.end()), folders.end());
  wait_for_all(folders.size(), [&](std::size_t i) { sync_folder(folders[i]); });
}

}  // namespace lightstage::core
