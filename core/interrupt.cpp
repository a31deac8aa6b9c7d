#include "core/interrupt.h"

#include <array>
#include <atomic>
#include <csignal>
#include <mutex>

#include "core/error.h"

namespace lightstage::core {

namespace {

constexpr std::array<int, 2> kSignals{SIGINT, SIGTERM};

// Only lock-free atomics may be touched in a signal handler.
std::atomic<int> arrived{0};
static_assert(std::atomic<int>::is_always_lock_free);

std::mutex guards_mutex;
int guard_count = 0;
std::array<struct sigaction, kSignals.size()> before{};

extern "C" void lightstage_core_on_signal(int signal_number) {
  if (arrived.exchange(signal_number) != 0) {
    std::signal(signal_number, SIG_DFL);
    std::raise(signal_number);  // delivered when this handler returns
  }
}

}  // namespace

InterruptGuard::InterruptGuard() {
  const std::lock_guard lock(guards_mutex);
  if (guard_count++ > 0) return;
  arrived = 0;
  struct sigaction action {};
  action.sa_handler = lightstage_core_on_signal;
  // Reads and writes in progress go on: a half-read file must not look like a damaged one.
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &action, &before[i]);
}

InterruptGuard::~InterruptGuard() {
  const std::lock_guard lock(guards_mutex);
  if (--guard_count > 0) return;
  for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before[i], nullptr);
}

bool interrupt_requested() {
  return arrived.load() != 0;
}

void throw_if_interrupted() {
  if (const int signal_number = arrived.load(); signal_number != 0)
    throw Interrupted(signal_number == SIGINT ? "interrupted (Ctrl-C)" : "interrupted (told to end)");
}

}  // namespace lightstage::core
