#include "support/support.h"

#include <cstdlib>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace lightstage::test {

namespace fs = std::filesystem;

TemporaryFolder::TemporaryFolder() {
  std::string pattern = (fs::temp_directory_path() / "lightstage-test-XXXXXX").string();
  if (mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("cannot make a temporary folder");
  path_ = pattern;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

EnvironmentVariable::EnvironmentVariable(std::string name, const std::string& value) : name_(std::move(name)) {
  if (const char* before = std::getenv(name_.c_str())) before_ = before;
  setenv(name_.c_str(), value.c_str(), 1);
}

EnvironmentVariable::~EnvironmentVariable() {
  if (before_) {
    setenv(name_.c_str(), before_->c_str(), 1);
  } else {
    unsetenv(name_.c_str());
  }
}

fs::path real_data(const std::string& below) {
  const char* chosen = std::getenv("LIGHTSTAGE_TEST_DATA");
  const fs::path folder = fs::path(chosen != nullptr ? chosen : LIGHTSTAGE_TEST_DATA_DEFAULT) / below;
  return fs::exists(folder) ? folder : fs::path();
}

}  // namespace lightstage::test
