// Preloaded into a program: counts the calls by which it changes files below a folder, and at a chosen one kills the program, makes the call fail, or
// only writes down what is done. Told by environment variables:
//   LIGHTSTAGE_FAULT_FOLDER   the folder, absolute
//   LIGHTSTAGE_FAULT          count              count only
//                             kill N             SIGKILL before the N-th call (from 1); of a write, every other time after half of it
//                             fail N ERRNO       the N-th call fails with that error
//                             full N             from the N-th call on the disk is full: all that makes files grow fails with ENOSPC, a write
//                                                after half of it
//                             short N            the N-th write does only half, which is no error
//                             map N              the N-th mapping of a file into memory fails
//                             memory N           the N-th allocation by operator new after the first change fails
//                             sqlite-memory N    the N-th allocation by SQLite after the first change fails
//   LIGHTSTAGE_FAULT_COUNT    file that holds, when the program ends, the numbers of calls, of writes among them, of mappings, and of allocations
//                             by operator new and by SQLite
//   LIGHTSTAGE_FAULT_RECORD   file to which every change is appended, in the order of happening (tests/fault/record.h)
#include <dlfcn.h>
#include <fcntl.h>
#include <link.h>
#include <sys/mman.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <new>
#include <string>

#include "fault/record.h"

namespace {

using lightstage::fault::RecordHeader;
using lightstage::fault::RecordKind;

enum class Mode { kCount, kKill, kFail, kFull, kShort, kMap, kMemory, kSqliteMemory };

template <class Function>
Function real(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

// The library's own allocations do not count, and do not fail.
thread_local int own_calls = 0;
struct Own {
  Own() { ++own_calls; }
  ~Own() { --own_calls; }
  Own(const Own&) = delete;
  Own& operator=(const Own&) = delete;
};

class Fault {
 public:
  Fault() {
    const char* folder = std::getenv("LIGHTSTAGE_FAULT_FOLDER");
    const char* what = std::getenv("LIGHTSTAGE_FAULT");
    if (folder == nullptr || what == nullptr) return;
    folder_ = folder;
    char mode[16] = "";
    std::sscanf(what, "%15s %ld %d", mode, &at_, &error_);
    if (std::strcmp(mode, "kill") == 0) mode_ = Mode::kKill;
    if (std::strcmp(mode, "fail") == 0) mode_ = Mode::kFail;
    if (std::strcmp(mode, "full") == 0) mode_ = Mode::kFull;
    if (std::strcmp(mode, "short") == 0) mode_ = Mode::kShort;
    if (std::strcmp(mode, "map") == 0) mode_ = Mode::kMap;
    if (std::strcmp(mode, "memory") == 0) mode_ = Mode::kMemory;
    if (std::strcmp(mode, "sqlite-memory") == 0) mode_ = Mode::kSqliteMemory;
    if (const char* file = std::getenv("LIGHTSTAGE_FAULT_RECORD")) {
      record_ = int(syscall(SYS_openat, AT_FDCWD, file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
    }
    active_ = true;
  }
  void finish() {
    if (!active_) return;
    active_ = false;
    const char* file = std::getenv("LIGHTSTAGE_FAULT_COUNT");
    if (file == nullptr) return;
    char text[128];
    const int length = std::snprintf(text, sizeof text, "%ld %ld %ld %ld %ld\n", calls_.load(), writes_, maps_.load(),
                                     allocations_.load(), sqlite_allocations_.load());
    const int out = int(syscall(SYS_openat, AT_FDCWD, file, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666));
    if (out >= 0 && syscall(SYS_write, out, text, length) != length) std::abort();
    if (out >= 0) syscall(SYS_close, out);
  }

  bool concerns(const std::string& path) const {
    return active_ && path.size() > folder_.size() && path.compare(0, folder_.size(), folder_) == 0 &&
           path[folder_.size()] == '/' && !path.ends_with("-shm");
  }
  std::string path_of(int fd) const {
    if (!active_) return {};
    char link[40], target[PATH_MAX];
    std::snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    const ssize_t length = readlink(link, target, sizeof target);
    return length > 0 ? std::string(target, std::size_t(length)) : std::string();
  }
  std::string absolute(const char* path) const {
    if (!active_) return {};
    if (path[0] == '/') return path;
    char here[PATH_MAX];
    return getcwd(here, sizeof here) == nullptr ? std::string(path) : std::string(here) + "/" + path;
  }

  // 0: go on; else the errno with which this call fails. `half` is set where a write is to be done by half first. `grows` says that the call needs room
  // on the disk.
  int next(bool grows, bool* half = nullptr) {
    ++calls_;
    if (half != nullptr && ++writes_ == at_ && mode_ == Mode::kShort) *half = true;
    if (mode_ == Mode::kKill && calls_ == at_) {
      if (half != nullptr && at_ % 2 == 0) {
        *half = true;
        return 0;
      }
      die();
    }
    if (mode_ == Mode::kFail && calls_ == at_) return error_;
    if (mode_ == Mode::kFull && calls_ >= at_ && grows) {
      if (half != nullptr && calls_ == at_) *half = true;
      return ENOSPC;
    }
    return 0;
  }
  bool kills() const { return mode_ == Mode::kKill; }
  [[noreturn]] static void die() {
    raise(SIGKILL);
    std::abort();
  }

  void note(RecordKind kind, const std::string& path, const std::string& to = {}, std::uint64_t offset = 0,
            const void* data = nullptr, std::size_t length = 0) const {
    if (record_ < 0) return;
    const RecordHeader header{
        std::uint32_t(kind), std::uint32_t(path.size()), std::uint32_t(to.size()), 0, offset, length};
    iovec parts[] = {{const_cast<RecordHeader*>(&header), sizeof header},
                     {const_cast<char*>(path.data()), path.size()},
                     {const_cast<char*>(to.data()), to.size()},
                     {const_cast<void*>(data), length}};
    const std::size_t total = sizeof header + path.size() + to.size() + length;
    if (syscall(SYS_writev, record_, parts, 4) != long(total)) std::abort();
  }

  // The first change of a file is when a program's work begins.
  bool allocation_fails() { return fails(Mode::kMemory, allocations_); }
  bool sqlite_allocation_fails() { return fails(Mode::kSqliteMemory, sqlite_allocations_); }
  bool mapping_fails(int fd) {
    const std::string path = path_of(fd);
    return active_ && path.compare(0, folder_.size() + 1, folder_ + "/") == 0 && ++maps_ == at_ && mode_ == Mode::kMap;
  }

  std::mutex mutex;  // changes happen, and are noted, one after the other

 private:
  bool fails(Mode mode, std::atomic<long>& count) {
    return active_ && own_calls == 0 && calls_ > 0 && ++count == at_ && mode_ == mode;
  }

  bool active_ = false;
  Mode mode_ = Mode::kCount;
  std::string folder_;
  long at_ = 0, writes_ = 0;
  int error_ = EIO, record_ = -1;
  std::atomic<long> calls_ = 0, maps_ = 0, allocations_ = 0, sqlite_allocations_ = 0;
};

// Whether the code at this address is SQLite's. Its place is found once, at the first change of a file: looking allocates.
struct Code {
  std::uintptr_t begin = 0, end = 0;
};
std::atomic<const Code*> sqlite = nullptr;

int note_if_sqlite(dl_phdr_info* info, size_t, void*) {
  if (std::strstr(info->dlpi_name, "libsqlite3") == nullptr) return 0;
  auto* code = new Code;
  for (int i = 0; i < info->dlpi_phnum; ++i) {
    const auto& part = info->dlpi_phdr[i];
    if (part.p_type != PT_LOAD || (part.p_flags & PF_X) == 0) continue;
    code->begin = info->dlpi_addr + part.p_vaddr;
    code->end = code->begin + part.p_memsz;
  }
  sqlite = code;
  return 1;
}

bool is_sqlite(const void* address) {
  const Code* code = sqlite;
  const auto at = reinterpret_cast<std::uintptr_t>(address);
  return code != nullptr && at >= code->begin && at < code->end;
}

// Allocates itself: what allocates while it is made must not wait for it.
std::atomic<Fault*> ready = nullptr;

Fault& fault() {
  static Fault* const instance = [] {
    dl_iterate_phdr(note_if_sqlite, nullptr);
    return new Fault;
  }();
  ready = instance;
  return *instance;
}

__attribute__((destructor)) void finish() {
  if (Fault* instance = ready) instance->finish();
}

// What libraries do after it is none of the program's work: DCMTK ends it by a signal where memory is short in its exit handlers.
using Main = int (*)(int, char**, char**);
Main own_main = nullptr;
int main_and_no_more(int argc, char** argv, char** environment) {
  const int status = own_main(argc, argv, environment);
  finish();
  return status;
}

int failed(int error) {
  errno = error;
  return -1;
}

// A write at an offset, in all its forms.
template <class Write>
ssize_t checked_write(int fd, const void* data, std::size_t length, std::int64_t offset, const Write& write) {
  const std::string path = fault().path_of(fd);
  if (!fault().concerns(path)) return write(length);
  const std::lock_guard lock(fault().mutex);
  bool half = false;
  const int error = fault().next(true, &half);
  if (half) {
    const ssize_t written = write(length / 2);
    if (fault().kills()) Fault::die();
    if (written > 0) {
      fault().note(RecordKind::kWrite, path, {}, std::uint64_t(offset), data, std::size_t(written));
      return written;
    }
  }
  if (error != 0) return failed(error);
  const ssize_t written = write(length);
  if (written > 0) fault().note(RecordKind::kWrite, path, {}, std::uint64_t(offset), data, std::size_t(written));
  return written;
}

template <class Sync>
int checked_sync(int fd, const Sync& sync) {
  const std::string path = fault().path_of(fd);
  if (!fault().concerns(path + "/") && !fault().concerns(path)) return sync();
  const std::lock_guard lock(fault().mutex);
  if (const int error = fault().next(false)) return failed(error);
  const int result = sync();
  if (result == 0) fault().note(RecordKind::kSync, path);
  return result;
}

template <class Open>
int checked_open(const std::string& path, int flags, const Open& open) {
  if ((flags & (O_CREAT | O_TRUNC)) == 0 || !fault().concerns(path)) return open();
  const std::lock_guard lock(fault().mutex);
  struct stat status {};
  const bool there = stat(path.c_str(), &status) == 0;
  if (there && (flags & O_TRUNC) == 0) return open();
  if (const int error = fault().next(true)) return failed(error);
  const int fd = open();
  if (fd >= 0) {
    if (!there) {
      fault().note(RecordKind::kCreate, path);
    } else {
      fault().note(RecordKind::kTruncate, path, {}, 0);
    }
  }
  return fd;
}

// A change of names: of one, or of one to another.
template <class Change>
int checked_change(RecordKind kind, const std::string& path, const std::string& to, bool grows, const Change& change) {
  if (!fault().concerns(path) && !fault().concerns(to)) return change();
  const std::lock_guard lock(fault().mutex);
  if (const int error = fault().next(grows)) return failed(error);
  const int result = change();
  if (result == 0) fault().note(kind, path, to);
  return result;
}

template <class Truncate>
int checked_truncate(int fd, off_t size, const Truncate& truncate) {
  const std::string path = fault().path_of(fd);
  if (!fault().concerns(path)) return truncate();
  const std::lock_guard lock(fault().mutex);
  if (const int error = fault().next(true)) return failed(error);
  const int result = truncate();
  if (result == 0) fault().note(RecordKind::kTruncate, path, {}, std::uint64_t(size));
  return result;
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  const Own own;
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  static const auto next = real<int (*)(const char*, int, ...)>("open");
  return checked_open(fault().absolute(path), flags, [&] { return next(path, flags, mode); });
}

int open64(const char* path, int flags, ...) {
  const Own own;
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  static const auto next = real<int (*)(const char*, int, ...)>("open64");
  return checked_open(fault().absolute(path), flags, [&] { return next(path, flags, mode); });
}

ssize_t write(int fd, const void* data, size_t length) {
  const Own own;
  static const auto next = real<ssize_t (*)(int, const void*, size_t)>("write");
  return checked_write(fd, data, length, lseek(fd, 0, SEEK_CUR), [&](size_t n) { return next(fd, data, n); });
}

ssize_t pwrite(int fd, const void* data, size_t length, off_t offset) {
  const Own own;
  static const auto next = real<ssize_t (*)(int, const void*, size_t, off_t)>("pwrite");
  return checked_write(fd, data, length, offset, [&](size_t n) { return next(fd, data, n, offset); });
}

ssize_t pwrite64(int fd, const void* data, size_t length, off64_t offset) {
  const Own own;
  static const auto next = real<ssize_t (*)(int, const void*, size_t, off64_t)>("pwrite64");
  return checked_write(fd, data, length, offset, [&](size_t n) { return next(fd, data, n, offset); });
}

ssize_t writev(int fd, const iovec* parts, int count) {
  const Own own;
  static const auto next = real<ssize_t (*)(int, const iovec*, int)>("writev");
  if (!fault().concerns(fault().path_of(fd))) return next(fd, parts, count);
  std::string whole;
  for (int i = 0; i < count; ++i) whole.append(static_cast<const char*>(parts[i].iov_base), parts[i].iov_len);
  return write(fd, whole.data(), whole.size());
}

// Copies of files: as a write of what was read.
ssize_t sendfile(int out, int in, off_t* offset, size_t length) {
  const Own own;
  static const auto next = real<ssize_t (*)(int, int, off_t*, size_t)>("sendfile");
  if (!fault().concerns(fault().path_of(out))) return next(out, in, offset, length);
  std::string block(std::min<size_t>(length, 1 << 20), '\0');
  const ssize_t got =
      offset != nullptr ? pread(in, block.data(), block.size(), *offset) : read(in, block.data(), block.size());
  if (got <= 0) return got;
  const ssize_t written = write(out, block.data(), size_t(got));
  if (written > 0 && offset != nullptr) *offset += written;
  if (written >= 0 && written < got && offset == nullptr) lseek(in, written - got, SEEK_CUR);
  return written;
}

ssize_t copy_file_range(int in, off64_t* from, int out, off64_t* to, size_t length, unsigned flags) {
  const Own own;
  static const auto next = real<ssize_t (*)(int, off64_t*, int, off64_t*, size_t, unsigned)>("copy_file_range");
  if (!fault().concerns(fault().path_of(out))) return next(in, from, out, to, length, flags);
  return failed(EXDEV);  // what is then done by other calls
}

int fsync(int fd) {
  const Own own;
  static const auto next = real<int (*)(int)>("fsync");
  return checked_sync(fd, [&] { return next(fd); });
}

int fdatasync(int fd) {
  const Own own;
  static const auto next = real<int (*)(int)>("fdatasync");
  return checked_sync(fd, [&] { return next(fd); });
}

int rename(const char* from, const char* to) {
  const Own own;
  static const auto next = real<int (*)(const char*, const char*)>("rename");
  return checked_change(RecordKind::kRename, fault().absolute(from), fault().absolute(to), true,
                        [&] { return next(from, to); });
}

int unlink(const char* path) {
  const Own own;
  static const auto next = real<int (*)(const char*)>("unlink");
  return checked_change(RecordKind::kRemove, fault().absolute(path), {}, false, [&] { return next(path); });
}

int remove(const char* path) {
  const Own own;
  static const auto next = real<int (*)(const char*)>("remove");
  return checked_change(RecordKind::kRemove, fault().absolute(path), {}, false, [&] { return next(path); });
}

int __libc_start_main(Main main, int argc, char** argv, void (*begin)(), void (*end)(), void (*end_of_linker)(),
                      void* stack_end) {
  static const auto next = real<decltype(&__libc_start_main)>("__libc_start_main");
  own_main = main;
  return next(main_and_no_more, argc, argv, begin, end, end_of_linker, stack_end);
}

int mkdir(const char* path, mode_t mode) {
  const Own own;
  static const auto next = real<int (*)(const char*, mode_t)>("mkdir");
  struct stat status {};
  if (stat(path, &status) == 0) return next(path, mode);
  return checked_change(RecordKind::kMakeFolder, fault().absolute(path), {}, true, [&] { return next(path, mode); });
}

int ftruncate(int fd, off_t size) {
  const Own own;
  static const auto next = real<int (*)(int, off_t)>("ftruncate");
  return checked_truncate(fd, size, [&] { return next(fd, size); });
}

int ftruncate64(int fd, off64_t size) {
  const Own own;
  static const auto next = real<int (*)(int, off64_t)>("ftruncate64");
  return checked_truncate(fd, size, [&] { return next(fd, size); });
}

void* mmap(void* address, size_t length, int protection, int flags, int fd, off_t offset) {
  const Own own;
  static const auto next = real<void* (*)(void*, size_t, int, int, int, off_t)>("mmap");
  if (fd >= 0 && ready.load() != nullptr && fault().mapping_fails(fd)) {
    errno = ENOMEM;
    return MAP_FAILED;
  }
  return next(address, length, protection, flags, fd, offset);
}

void* mmap64(void* address, size_t length, int protection, int flags, int fd, off64_t offset) {
  return mmap(address, length, protection, flags, fd, offset);
}

// The C library's own, under the names by which it may be called past this one.
void* __libc_malloc(size_t size);
void* __libc_realloc(void* memory, size_t size);

void* malloc(size_t size) {
  if (is_sqlite(__builtin_return_address(0)) && fault().sqlite_allocation_fails()) return nullptr;
  return __libc_malloc(size);
}

void* realloc(void* memory, size_t size) {
  if (is_sqlite(__builtin_return_address(0)) && fault().sqlite_allocation_fails()) return nullptr;
  return __libc_realloc(memory, size);
}

}  // extern "C"

void* operator new(std::size_t size) {
  if (Fault* instance = ready; instance == nullptr || !instance->allocation_fails()) {
    if (void* memory = std::malloc(size == 0 ? 1 : size)) return memory;
  }
  if (const std::new_handler handler = std::get_new_handler()) handler();
  throw std::bad_alloc();
}
void* operator new[](std::size_t size) {
  return operator new(size);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete[](void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  std::free(memory);
}
