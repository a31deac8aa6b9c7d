// Whole small files, read with limits and written so that nothing is ever half there.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace lightstage::core {

// The file's bytes. Throws BadInput naming the file when it is missing, not a regular file, or larger than
// `max_bytes`.
std::string read_text_file(const std::filesystem::path& path, std::size_t max_bytes = std::size_t(64) << 20);

// Writes to a temporary file beside the target, syncs, renames over the target and syncs the folder. A symbolic
// link stays, what it names is replaced. Throws BadInput when the folder is missing, the disk is full, or something
// that is not a regular file (a folder, a device, a pipe) stands there; the target is then as it was.
void write_file_atomically(const std::filesystem::path& path, std::string_view bytes);

// Calls `write(temporary_path)` and then moves the result into place as above; the temporary file has the
// target's extension. Removes it when `write` throws.
template <class Write>
void replace_file_atomically(const std::filesystem::path& path, Write&& write);

// Syncs the file and moves it to another name on the same file system, in the place of what stands there, durably. Throws as
// write_file_atomically.
void move_file_durably(const std::filesystem::path& from, const std::filesystem::path& to);

// Makes the folder, with those above it, where there is none. BadInput where that cannot be.
void make_folder(const std::filesystem::path& folder);

// The system's folder for temporary files. Throws BadInput naming it when $TMPDIR is set and names no folder.
std::filesystem::path temporary_folder();

namespace file_detail {
std::filesystem::path temporary_beside(const std::filesystem::path& path);
void discard(const std::filesystem::path& temporary) noexcept;
}  // namespace file_detail

template <class Write>
void replace_file_atomically(const std::filesystem::path& path, Write&& write) {
  const std::filesystem::path temporary = file_detail::temporary_beside(path);
  try {
    write(temporary);
    move_file_durably(temporary, path);
  } catch (...) {
    file_detail::discard(temporary);
    throw;
  }
}

}  // namespace lightstage::core
