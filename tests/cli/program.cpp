#include "cli/program.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "support/support.h"

namespace lightstage::test {

namespace fs = std::filesystem;

namespace {

std::string contents(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

int start(const fs::path& store, std::vector<std::string> arguments, const fs::path& out, const fs::path& err) {
  arguments.insert(arguments.begin(), LIGHTSTAGE_PROGRAM);
  arguments.insert(arguments.end(), {"--store", store.string()});
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  const int pid = fork();
  if (pid < 0) throw std::runtime_error("fork failed");
  if (pid == 0) {
    const int out_file = open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    const int err_file = open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(out_file, STDOUT_FILENO);
    dup2(err_file, STDERR_FILENO);
    execv(argv[0], argv.data());
    _exit(127);
  }
  return pid;
}

int wait_for(int pid) {
  int status = 0;
  if (waitpid(pid, &status, 0) != pid) throw std::runtime_error("waitpid failed");
  return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

}  // namespace

Outcome run_program(const fs::path& store, std::vector<std::string> arguments) {
  const TemporaryFolder folder;
  Outcome outcome;
  outcome.status = wait_for(start(store, std::move(arguments), folder / "out", folder / "err"));
  outcome.out = contents(folder / "out");
  outcome.err = contents(folder / "err");
  return outcome;
}

BackgroundRun::BackgroundRun(const fs::path& store, std::vector<std::string> arguments, const fs::path& err)
    : pid_(start(store, std::move(arguments), "/dev/null", err)) {}

BackgroundRun::~BackgroundRun() {
  if (pid_ < 0) return;
  kill(pid_, SIGKILL);
  wait_for(pid_);
}

void BackgroundRun::signal(int number) const {
  kill(pid_, number);
}

int BackgroundRun::wait() {
  const int status = wait_for(pid_);
  pid_ = -1;
  return status;
}

std::string fingerprint(const fs::path& folder) {
  std::vector<std::string> lines;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    const std::string bytes = contents(entry.path());
    lines.push_back(entry.path().lexically_relative(folder).string() + " " + std::to_string(bytes.size()) + " " +
                    std::to_string(std::hash<std::string>()(bytes)));
  }
  std::sort(lines.begin(), lines.end());
  std::ostringstream all;
  for (const std::string& line : lines) all << line << "\n";
  return all.str();
}

}  // namespace lightstage::test
