// A real file system of a few megabytes, that can be filled to the last byte.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace lightstage::test {

// A tmpfs that this process and those that it starts see, mounted at the folder (which must be there) for as long as this lives.
class SmallDisk {
 public:
  SmallDisk(const std::filesystem::path& folder, std::size_t megabytes);
  ~SmallDisk();
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  // Why there is none: the machine lets this process mount nothing. Then skip the test.
  const std::string& problem() const { return problem_; }

  // Mounts it anew so that nothing can be written. Nobody may have a file there open for writing.
  bool make_read_only() const;

  // Writes a file of this name until so many bytes are free.
  void fill(const std::string& name, std::size_t bytes_left = 0) const;

 private:
  std::filesystem::path folder_;
  std::string problem_;
};

}  // namespace lightstage::test
