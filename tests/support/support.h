// What tests of all rooms share.
#pragma once

#include <filesystem>
#include <iostream>
#include <optional>
#include <string>

// Ends the test case and has CTest count it as skipped, with the reason in the log.
#define SKIP_TEST(reason)                         \
  do {                                            \
    std::cout << "SKIPPED: " << (reason) << "\n"; \
    return;                                       \
  } while (false)

namespace lightstage::test {

// A fresh folder that is removed with everything in it at the end of the scope.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

// An environment variable that has this value until the end of the scope.
class EnvironmentVariable {
 public:
  EnvironmentVariable(std::string name, const std::string& value);
  ~EnvironmentVariable();
  EnvironmentVariable(const EnvironmentVariable&) = delete;
  EnvironmentVariable& operator=(const EnvironmentVariable&) = delete;

 private:
  std::string name_;
  std::optional<std::string> before_;
};

// The folder of real photographs ($LIGHTSTAGE_TEST_DATA, by default ../shared/data beside the source tree), or an empty
// path when `below` does not exist in it: then skip the test.
std::filesystem::path real_data(const std::string& below);

}  // namespace lightstage::test
