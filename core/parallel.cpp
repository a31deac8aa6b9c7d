#include "core/parallel.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "core/error.h"
#include "core/text.h"

namespace lightstage::core {

namespace {

int processor_count() {
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof set, &set) == 0) return std::max(1, CPU_COUNT(&set));
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

int default_thread_count() {
  const char* chosen = std::getenv("LIGHTSTAGE_THREADS");
  if (chosen == nullptr || *chosen == '\0') return processor_count();
  const std::optional<std::int64_t> n = parse_integer(trim(chosen));
  if (!n || *n < 1 || *n > 4096)
    throw UsageError("LIGHTSTAGE_THREADS must be a number of threads from 1 to 4096, not '" + std::string(chosen) +
                     "'");
  return static_cast<int>(*n);
}

// The threads of all loops. The limit lets TBB have more threads than processors when that is what was asked
// for.
struct Workers {
  explicit Workers(int n)
      : count(n), limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(n)), arena(n) {}
  int count;
  tbb::global_control limit;
  tbb::task_arena arena;
};

std::mutex workers_mutex;
int chosen_count = 0;
std::shared_ptr<Workers> current_workers;

int locked_thread_count() {
  return chosen_count > 0 ? chosen_count : default_thread_count();
}

std::shared_ptr<Workers> workers() {
  const std::lock_guard lock(workers_mutex);
  if (current_workers == nullptr) current_workers = std::make_shared<Workers>(locked_thread_count());
  return current_workers;
}

}  // namespace

int thread_count() {
  const std::lock_guard lock(workers_mutex);
  return locked_thread_count();
}

void set_thread_count(int n) {
  const std::lock_guard lock(workers_mutex);
  chosen_count = std::max(0, n);
  current_workers.reset();
}

#if defined(__SANITIZE_THREAD__)
// ThreadSanitizer does not see how TBB, which is not built with it, hands work from thread to thread, and takes every loop for a race. These threads
// it knows; only tests under it use them.
namespace {

void run_on_threads(int thread_count, std::size_t range_count, const std::function<void(std::size_t)>& run) {
  std::atomic<std::size_t> next = 0;
  std::mutex mutex;
  std::exception_ptr failure;
  const auto work = [&] {
    for (std::size_t range = next++; range < range_count; range = next++) {
      try {
        run(range);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!failure) failure = std::current_exception();
        next = range_count;
      }
    }
  };
  std::vector<std::thread> threads;
  for (int i = 1; i < thread_count; ++i) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace
#endif

void parallel_for(std::size_t count, std::size_t grain,
                  const std::function<void(std::size_t first, std::size_t last)>& body) {
  const std::size_t step = std::max<std::size_t>(1, grain);
  const std::size_t range_count = count / step + (count % step != 0 ? 1 : 0);
  const auto run = [&](std::size_t range) { body(range * step, std::min(count, range * step + step)); };
  if (range_count == 0) return;
  const std::shared_ptr<Workers> team = workers();
  if (team->count == 1 || range_count == 1) {
    for (std::size_t range = 0; range < range_count; ++range) run(range);
    return;
  }
#if defined(__SANITIZE_THREAD__)
  run_on_threads(team->count, range_count, run);
#else
  team->arena.execute([&] {
    // Isolated: a thread that waits for a nested loop must not take up other work of an outer one, which
    // might wait for what this very thread is making.
    tbb::this_task_arena::isolate([&] {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, range_count),
                        [&](const tbb::blocked_range<std::size_t>& ranges) {
                          for (std::size_t range = ranges.begin(); range != ranges.end(); ++range) run(range);
                        });
    });
  });
#endif
}

}  // namespace lightstage::core
