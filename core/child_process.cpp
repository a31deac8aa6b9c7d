#include "core/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <new>
#include <string_view>

#include "core/error.h"
#include "core/interrupt.h"

namespace lightstage::core {

namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define LIGHTSTAGE_SANITIZED
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define LIGHTSTAGE_SANITIZED
#endif
#endif
#ifdef LIGHTSTAGE_SANITIZED
constexpr bool kSanitized = true;  // which reserves terabytes of addresses
#else
constexpr bool kSanitized = false;
#endif

// The first byte of what the child sends.
enum class Outcome : char { kDone, kBadInput, kNoMemory };

void send(int to, std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(to, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) std::_Exit(1);
    text.remove_prefix(std::size_t(n));
  }
}

void limit(int resource, rlim_t value) {
  const rlimit both{value, value};
  ::setrlimit(static_cast<decltype(RLIMIT_CPU)>(resource), &both);
}

void keep_to(const ChildLimits& limits) {
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_CPU, rlim_t(limits.processor_time.count()));
  std::size_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  if (!kSanitized && pages > 0) limit(RLIMIT_AS, pages * std::size_t(::sysconf(_SC_PAGESIZE)) + limits.memory_bytes);
}

// In the child. Its end must run nothing of the parent's: no destructors, no buffers written twice.
[[noreturn]] void carry_out(int to, const ChildLimits& limits, const std::function<std::string()>& work) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  // Its crashes are nobody's business, a fuzzer's least of all.
  for (const int signal : {SIGINT, SIGTERM, SIGPIPE, SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGALRM, SIGXCPU}) {
    std::signal(signal, SIG_DFL);
  }
  const int nowhere = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  for (const int stream : {STDOUT_FILENO, STDERR_FILENO}) ::dup2(nowhere, stream);
  const auto answer = [to](Outcome outcome, std::string_view text) {
    const char first = static_cast<char>(outcome);
    send(to, {&first, 1});
    send(to, text);
    std::_Exit(0);
  };
  try {
    keep_to(limits);
    answer(Outcome::kDone, work());
  } catch (const Error& error) {
    answer(Outcome::kBadInput, error.what());
  } catch (const std::bad_alloc&) {
    answer(Outcome::kNoMemory, {});
  } catch (...) {
  }
  std::_Exit(1);
}

// A child that is ended and waited for, whatever happens.
class Child {
 public:
  explicit Child(pid_t id) : id_(id) {}
  ~Child() {
    if (id_ > 0) ::kill(id_, SIGKILL);
    wait();
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  // Its status; 0 when there is none.
  int wait() {
    int status = 0;
    while (id_ > 0 && ::waitpid(id_, &status, 0) < 0 && errno == EINTR) {
    }
    id_ = 0;
    return status;
  }

 private:
  pid_t id_;
};

class Pipe {
 public:
  Pipe() {
    if (::pipe2(ends_, O_CLOEXEC) != 0) ends_[0] = ends_[1] = -1;
  }
  ~Pipe() {
    close(0);
    close(1);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  int end(int which) const { return ends_[which]; }
  void close(int which) {
    if (ends_[which] >= 0) ::close(ends_[which]);
    ends_[which] = -1;
  }

 private:
  int ends_[2];
};

std::string all_from(int from) {
  constexpr int kLookForInterrupts = 100;  // ms
  std::string bytes;
  for (;;) {
    throw_if_interrupted();
    pollfd wanted{from, POLLIN, 0};
    if (::poll(&wanted, 1, kLookForInterrupts) <= 0) continue;
    char block[1 << 16];
    const ssize_t n = ::read(from, block, sizeof block);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return bytes;
    bytes.append(block, std::size_t(n));
  }
}

}  // namespace

std::string in_child(const std::filesystem::path& file, const ChildLimits& limits,
                     const std::function<std::string()>& work) {
  Pipe pipe;
  const pid_t id = pipe.end(0) >= 0 ? ::fork() : -1;
  if (id < 0) throw BadInput(file.string() + ": cannot be read: no process could be made: " + std::strerror(errno));
  if (id == 0) carry_out(pipe.end(1), limits, work);
  Child child(id);
  pipe.close(1);
  std::string bytes = all_from(pipe.end(0));
  const int status = child.wait();
  if (WIFSIGNALED(status) && (WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL)) {
    throw BadInput(file.string() + ": reading it takes longer than " + std::to_string(limits.processor_time.count()) +
                   " s; it is damaged, or far too large");
  }
  if (status != 0 || bytes.empty()) throw BadInput(file.string() + ": is damaged: its reader crashed on it");
  const Outcome outcome{bytes.front()};
  bytes.erase(0, 1);
  if (outcome == Outcome::kBadInput) throw BadInput(bytes);
  if (outcome == Outcome::kNoMemory) {
    throw BadInput(file.string() + ": reading it takes more memory than a file of its size should need");
  }
  return bytes;
}

}  // namespace lightstage::core
