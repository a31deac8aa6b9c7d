#include "cli/jobs/environments.h"

#include "core/progress.h"

namespace lightstage::cli {

relight::Environment read_environment(const std::filesystem::path& file) {
  relight::Environment environment = relight::Environment::read(file);
  if (environment.negative_values() > 0) {
    core::warn(file.string() + ": " + std::to_string(environment.negative_values()) + " negative values count as 0");
  }
  return environment;
}

}  // namespace lightstage::cli
