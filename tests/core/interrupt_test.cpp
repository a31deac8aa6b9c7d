#include "core/interrupt.h"

#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <csignal>

#include "core/error.h"
#include "support/support.h"

using namespace lightstage;

namespace {

volatile std::sig_atomic_t outer_calls = 0;
void count_call(int) {
  outer_calls = outer_calls + 1;
}

// How a child process ends that runs `function` and then exits with 7.
template <class Function>
int end_of_child(const Function& function) {
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    function();
    _exit(7);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return status;
}

}  // namespace

TEST_CASE("a signal is turned into an exception at the next look") {
  for (const int signal_number : {SIGINT, SIGTERM}) {
    const core::InterruptGuard guard;
    CHECK_FALSE(core::interrupt_requested());
    CHECK_NOTHROW(core::throw_if_interrupted());
    std::raise(signal_number);
    CHECK(core::interrupt_requested());
    CHECK_THROWS_AS(core::throw_if_interrupted(), core::Interrupted);
    CHECK_THROWS_AS(core::throw_if_interrupted(), core::Interrupted);  // and stays so
  }
}

TEST_CASE("the guard gives back the handlers it found, also when nested") {
  struct sigaction before {
  }, mine{};
  mine.sa_handler = count_call;
  sigaction(SIGINT, &mine, &before);
  {
    const core::InterruptGuard outer;
    { const core::InterruptGuard inner; }
    std::raise(SIGINT);
    CHECK(outer_calls == 0);
    CHECK(core::interrupt_requested());
  }
  std::raise(SIGINT);
  CHECK(outer_calls == 1);
  sigaction(SIGINT, &before, nullptr);
}

TEST_CASE("a second signal ends the process by the signal's own action") {
#ifdef __SANITIZE_THREAD__
  SKIP_TEST("ThreadSanitizer holds back a signal that is raised in a handler");
#endif
  const auto twice = [](int second) {
    return end_of_child([second] {
      std::signal(SIGINT, SIG_DFL);
      std::signal(SIGTERM, SIG_DFL);
      const core::InterruptGuard guard;
      std::raise(SIGINT);
      if (core::interrupt_requested()) std::raise(second);
    });
  };
  for (const int second : {SIGINT, SIGTERM}) {
    const int status = twice(second);
    CHECK(WIFSIGNALED(status));
    CHECK(WTERMSIG(status) == second);
  }
  // The first alone does not.
  const int once = end_of_child([] {
    const core::InterruptGuard guard;
    std::raise(SIGTERM);
  });
  CHECK(WIFEXITED(once));
  CHECK(WEXITSTATUS(once) == 7);
}
