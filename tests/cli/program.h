// Runs the built program as a user would.
#pragma once

#include <nlohmann/json.hpp>

#include <filesystem>
#include <string>
#include <vector>

namespace lightstage::test {

struct Outcome {
  int status = 0;  // exit status; 128 + n when ended by signal n
  std::string out, err;

  nlohmann::json json() const { return nlohmann::json::parse(out); }
};

// The program started with a store of its own; waits for its end.
Outcome run_program(const std::filesystem::path& store, std::vector<std::string> arguments);

// The same in the background, for killing.
class BackgroundRun {
 public:
  // What it says on stderr goes to `err`.
  BackgroundRun(const std::filesystem::path& store, std::vector<std::string> arguments,
                const std::filesystem::path& err = "/dev/null");
  ~BackgroundRun();
  BackgroundRun(const BackgroundRun&) = delete;
  BackgroundRun& operator=(const BackgroundRun&) = delete;
  int pid() const { return pid_; }
  void signal(int number) const;
  int wait();  // as Outcome::status

 private:
  int pid_ = -1;
};

// Names, sizes and contents (hashed) of all files below a folder, a line a file: equal for equal folders.
std::string fingerprint(const std::filesystem::path& folder);

}  // namespace lightstage::test
