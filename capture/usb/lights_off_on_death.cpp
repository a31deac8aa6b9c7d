#include "capture/usb/lights_off_on_death.h"

#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>

#include "core/error.h"

namespace lightstage::capture {

namespace {

constexpr char kOn = '1', kOff = '0';

[[noreturn]] void fail(const char* doing) {
  throw core::DeviceError(std::string("cannot guard the lights against this program's death: ") + doing + ": " +
                          std::strerror(errno));
}

// In a process that was forked from one that may have threads: only what is allowed in a signal handler.
[[noreturn]] void guard(int socket, char* const* command) {
  // Above all the socket's other end is closed, through which this process would keep itself waiting.
  constexpr int kSocket = 3;
  if (socket != kSocket) dup2(socket, kSocket);
  close_range(kSocket + 1, ~0U, 0);
  char last = kOff;
  while (true) {
    char byte = 0;
    const ssize_t count = read(kSocket, &byte, 1);
    if (count == 1) last = byte;
    if (count == 0 || (count < 0 && errno != EINTR)) break;
  }
  if (last == kOff) _exit(0);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  execv(command[0], command);
  _exit(127);
}

}  // namespace

LightsOffOnDeath::LightsOffOnDeath(const std::vector<std::string>& command) {
  std::vector<std::string> words = command;
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);

  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) fail("socketpair");
  // A child of a child: it is nobody's to wait for afterwards.
  const pid_t child = fork();
  if (child == 0) {
    setsid();
    const pid_t grandchild = fork();
    if (grandchild == 0) guard(ends[0], arguments.data());
    _exit(grandchild < 0 ? 1 : 0);
  }
  close(ends[0]);
  int status = 1;
  if (child > 0) {
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
  }
  if (status != 0) {
    close(ends[1]);
    fail("fork");
  }
  socket_ = ends[1];
}

LightsOffOnDeath::~LightsOffOnDeath() {
  close(socket_);
}

void LightsOffOnDeath::tell(bool on) noexcept {
  if (on == on_) return;
  on_ = on;
  const char byte = on ? kOn : kOff;
  // Fails only when the other process is gone, and then there is nobody to tell.
  while (send(socket_, &byte, 1, MSG_NOSIGNAL) < 0 && errno == EINTR) {
  }
}

}  // namespace lightstage::capture
