#include "fault/program.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

extern char** environ;

namespace lightstage::fault {

namespace fs = std::filesystem;

namespace {

fs::path program_path, shim_path;

std::string read_file(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

struct CapturedFile {
  std::string path = (fs::temp_directory_path() / "lightstage-fault-XXXXXX").string();
  CapturedFile() {
    const int fd = mkstemp(path.data());
    if (fd < 0) throw std::runtime_error(path + ": " + std::strerror(errno));
    close(fd);
  }
  ~CapturedFile() {
    std::error_code ignored;
    fs::remove(path, ignored);
  }
  CapturedFile(const CapturedFile&) = delete;
  CapturedFile& operator=(const CapturedFile&) = delete;
};

}  // namespace

void set_paths(const fs::path& program, const fs::path& shim) {
  program_path = fs::absolute(program);
  shim_path = fs::absolute(shim);
}

Outcome run_program(const std::vector<std::string>& arguments, const Disturbance& disturbance) {
  std::vector<std::string> words{program_path.string()};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<std::string> environment;
  for (char** variable = environ; *variable != nullptr; ++variable) environment.emplace_back(*variable);
  if (!disturbance.fault.empty()) {
    environment.push_back("LD_PRELOAD=" + shim_path.string());
    environment.push_back("LIGHTSTAGE_FAULT=" + disturbance.fault);
    environment.push_back("LIGHTSTAGE_FAULT_FOLDER=" + fs::absolute(disturbance.folder).lexically_normal().string());
    if (!disturbance.count_file.empty())
      environment.push_back("LIGHTSTAGE_FAULT_COUNT=" + disturbance.count_file.string());
    if (!disturbance.record_file.empty())
      environment.push_back("LIGHTSTAGE_FAULT_RECORD=" + disturbance.record_file.string());
  }
  const auto pointers = [](std::vector<std::string>& texts) {
    std::vector<char*> list;
    for (std::string& text : texts) list.push_back(text.data());
    list.push_back(nullptr);
    return list;
  };
  const CapturedFile out, err;
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, out.path.c_str(), O_WRONLY | O_TRUNC, 0);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, err.path.c_str(), O_WRONLY | O_TRUNC, 0);
  pid_t process = -1;
  const int failure =
      posix_spawn(&process, words[0].c_str(), &actions, nullptr, pointers(words).data(), pointers(environment).data());
  posix_spawn_file_actions_destroy(&actions);
  if (failure != 0) throw std::runtime_error(words[0] + ": " + std::strerror(failure));

  constexpr auto kLongest = std::chrono::minutes(2);
  const auto deadline = std::chrono::steady_clock::now() + kLongest;
  Outcome outcome;
  int status = 0;
  for (;;) {
    if (waitpid(process, &status, WNOHANG) == process) {
      outcome.status = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
      break;
    }
    if (std::chrono::steady_clock::now() > deadline) {
      kill(process, SIGKILL);
      waitpid(process, &status, 0);
      outcome.status = 124;
      break;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  outcome.out = read_file(out.path);
  outcome.err = read_file(err.path);
  return outcome;
}

}  // namespace lightstage::fault
