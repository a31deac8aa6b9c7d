#include "core/file.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>

#include "core/error.h"
#include "core/file_descriptor.h"
#include "core/sync_folder.h"

namespace lightstage::core {

namespace fs = std::filesystem;

namespace {

FileDescriptor open_file(const fs::path& path, int flags) {
  return FileDescriptor(::open(path.c_str(), flags | O_CLOEXEC, 0666));
}

BadInput system_failure(const std::string& action, const fs::path& path) {
  return BadInput(action + " " + path.string() + ": " + std::strerror(errno));
}

fs::path folder_of(const fs::path& path) {
  const fs::path folder = path.parent_path();
  return folder.empty() ? fs::path(".") : folder;
}

// What is to be replaced: the path itself, or what it names where it is a symbolic link. Renaming would put a file in the place of a
// device as readily as of a file.
fs::path target_of(const fs::path& path) {
  if (path.empty()) throw BadInput("cannot write '': a file needs a name");
  const auto refuse = [&](const std::string& problem) {
    return BadInput("cannot write " + path.string() + ": " + problem);
  };
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (path.filename().empty() || fs::is_directory(status)) throw refuse("it names a folder");
  if (fs::exists(status) && !fs::is_regular_file(status)) throw refuse("what stands there is not a regular file");
  fs::path target = path;
  constexpr int kMostLinks = 40;  // as many as Linux follows
  for (int links = 0; fs::is_symlink(fs::symlink_status(target, error)); ++links) {
    if (links == kMostLinks) throw refuse("its symbolic links do not end");
    target = folder_of(target) / fs::read_symlink(target, error);
  }
  return target;
}

}  // namespace

std::string read_text_file(const fs::path& path, std::size_t max_bytes) {
  // Not blocking, so that a pipe is refused below instead of waited for.
  const FileDescriptor file = open_file(path, O_RDONLY | O_NONBLOCK);
  struct stat status {};
  if (!file.is_open() || fstat(file.get(), &status) != 0) throw system_failure("cannot read", path);
  if (!S_ISREG(status.st_mode)) throw BadInput("cannot read " + path.string() + ": not a regular file");

  std::string bytes;
  const auto too_large = [&] {
    return BadInput("cannot read " + path.string() + ": larger than the " + std::to_string(max_bytes) +
                    " bytes such a file may have");
  };
  if (static_cast<std::uintmax_t>(status.st_size) > max_bytes) throw too_large();
  bytes.reserve(static_cast<std::size_t>(status.st_size));
  char block[1 << 16];
  for (;;) {
    const ssize_t n = ::read(file.get(), block, sizeof block);
    if (n == 0) return bytes;
    if (n < 0) {
      if (errno == EINTR) continue;
      throw system_failure("cannot read", path);
    }
    if (bytes.size() + static_cast<std::size_t>(n) > max_bytes) throw too_large();
    bytes.append(block, static_cast<std::size_t>(n));
  }
}

void write_file_atomically(const fs::path& path, std::string_view bytes) {
  replace_file_atomically(path, [&](const fs::path& temporary) {
    FileDescriptor file = open_file(temporary, O_WRONLY | O_CREAT | O_EXCL);
    if (!file.is_open()) throw system_failure("cannot write", path);
    while (!bytes.empty()) {
      const ssize_t n = ::write(file.get(), bytes.data(), bytes.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) throw system_failure("cannot write", path);
      bytes.remove_prefix(static_cast<std::size_t>(n));
    }
    if (!file.close()) throw system_failure("cannot write", path);
  });
}

void move_file_durably(const fs::path& temporary, const fs::path& path) {
  {
    FileDescriptor file = open_file(temporary, O_RDONLY);
    if (!file.is_open() || fsync(file.get()) != 0 || !file.close()) throw system_failure("cannot write", path);
  }
  const fs::path target = target_of(path);
  if (std::rename(temporary.c_str(), target.c_str()) != 0) throw system_failure("cannot write", path);
  sync_folder(folder_of(target));
}

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error || !fs::is_directory(folder)) {
    throw BadInput(folder.string() + ": cannot make this folder" +
                   (error ? " (" + error.message() + ")" : std::string()));
  }
}

fs::path temporary_folder() {
  std::error_code error;
  fs::path folder = fs::temp_directory_path(error);
  if (!error) return folder;
  std::string named;
  for (const char* variable : {"TEMPDIR", "TEMP", "TMP", "TMPDIR"}) {  // the last one set is the one that counts
    if (const char* value = std::getenv(variable)) named = std::string(variable) + "=" + value;
  }
  throw BadInput(named + ": this folder for temporary files is not there; set TMPDIR to one that takes files");
}

namespace file_detail {

fs::path temporary_beside(const fs::path& path) {
  const fs::path folder = folder_of(target_of(path));
  std::error_code error;
  if (!fs::is_directory(folder, error))
    throw BadInput("cannot write " + path.string() + ": there is no folder " + folder.string());
  // Random, because several processes, on several machines, may write into one folder.
  std::random_device random;
  char name[40];
  std::snprintf(name, sizeof name, ".lightstage-%08x%08x", random(), random());
  return folder / (name + path.extension().string());
}

void discard(const fs::path& temporary) noexcept {
  std::error_code ignored;
  fs::remove(temporary, ignored);
}

}  // namespace file_detail

}  // namespace lightstage::core
