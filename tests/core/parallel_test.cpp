#include "core/parallel.h"

#include <sched.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <cstdlib>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>

#include "core/error.h"

using namespace lightstage;

namespace {

using Ranges = std::set<std::pair<std::size_t, std::size_t>>;

Ranges ranges_of(std::size_t count, std::size_t grain) {
  Ranges ranges;
  std::mutex mutex;
  core::parallel_for(count, grain, [&](std::size_t first, std::size_t last) {
    const std::lock_guard lock(mutex);
    CHECK(ranges.emplace(first, last).second);
  });
  return ranges;
}

}  // namespace

TEST_CASE("ranges cover everything once and are the same for every thread count") {
  for (const auto& [count, grain] : {std::pair{0, 4}, {1, 4}, {4, 4}, {5, 4}, {1009, 17}, {3, 1000}, {7, 0}}) {
    core::set_thread_count(1);
    const Ranges alone = ranges_of(std::size_t(count), std::size_t(grain));
    std::size_t next = 0;
    for (const auto& [first, last] : alone) {
      CHECK(first == next);
      CHECK(last > first);
      CHECK(last - first <= std::size_t(std::max(1, grain)));
      next = last;
    }
    CHECK(next == std::size_t(count));
    for (const int threads : {2, 3, 8}) {
      core::set_thread_count(threads);
      CHECK(ranges_of(std::size_t(count), std::size_t(grain)) == alone);
    }
  }
  core::set_thread_count(0);
}

TEST_CASE("as many threads work at once as were asked for, even more than there are processors") {
  for (const int threads : {2, 4}) {
    core::set_thread_count(threads);
    // Everybody waits inside until as many are there as there should be; a missing thread shows as a time-out.
    std::atomic<int> inside{0}, most{0};
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    core::parallel_for(64, 1, [&](std::size_t, std::size_t) {
      const int now = ++inside;
      int seen = most.load();
      while (seen < now && !most.compare_exchange_weak(seen, now)) {
      }
      while (most < threads && std::chrono::steady_clock::now() < deadline)
        std::this_thread::sleep_for(std::chrono::microseconds(100));
      --inside;
    });
    CHECK(most == threads);
  }
  core::set_thread_count(0);
}

TEST_CASE("loops may be nested") {
  core::set_thread_count(3);
  std::atomic<int> sum{0};
  core::parallel_for(20, 1, [&](std::size_t, std::size_t) {
    core::parallel_for(30, 2, [&](std::size_t first, std::size_t last) { sum += int(last - first); });
  });
  CHECK(sum == 600);
  core::set_thread_count(0);
}

TEST_CASE("a thread that waits for an inner loop takes up no more of the outer one") {
  // Else it could be made to wait for what it is itself in the middle of making.
  core::set_thread_count(4);
  static thread_local bool inside_outer = false;
  std::atomic<int> interleaved{0};
  for (int round = 0; round < 30; ++round) {
    core::parallel_for(9, 1, [&](std::size_t, std::size_t) {
      if (inside_outer) ++interleaved;
      inside_outer = true;
      // One range is long; the thread that began the loop may be left waiting for it.
      core::parallel_for(8, 1, [](std::size_t first, std::size_t) {
        std::this_thread::sleep_for(std::chrono::microseconds(first == 7 ? 2000 : 50));
      });
      inside_outer = false;
    });
  }
  CHECK(interleaved == 0);
  core::set_thread_count(0);
}

TEST_CASE("what a body throws comes out of the loop after all bodies have ended") {
  for (const int threads : {1, 4}) {
    core::set_thread_count(threads);
    std::atomic<int> inside{0};
    const auto body = [&](std::size_t first, std::size_t) {
      ++inside;
      std::this_thread::sleep_for(std::chrono::microseconds(100));
      --inside;
      if (first == 11) throw core::StoreError("broken");
    };
    CHECK_THROWS_AS(core::parallel_for(50, 1, body), core::StoreError);
    CHECK(inside == 0);
  }
  core::set_thread_count(0);
}

TEST_CASE("the thread count comes from the setting, the environment, or the processors allowed") {
  unsetenv("LIGHTSTAGE_THREADS");
  core::set_thread_count(0);
  cpu_set_t before;
  REQUIRE(sched_getaffinity(0, sizeof before, &before) == 0);
  CHECK(core::thread_count() == CPU_COUNT(&before));
  cpu_set_t one;
  CPU_ZERO(&one);
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu)
    if (CPU_ISSET(cpu, &before)) {
      CPU_SET(cpu, &one);
      break;
    }
  REQUIRE(sched_setaffinity(0, sizeof one, &one) == 0);
  CHECK(core::thread_count() == 1);
  sched_setaffinity(0, sizeof before, &before);

  setenv("LIGHTSTAGE_THREADS", "3", 1);
  CHECK(core::thread_count() == 3);
  core::set_thread_count(5);
  CHECK(core::thread_count() == 5);
  core::set_thread_count(-1);
  CHECK(core::thread_count() == 3);
  for (const char* text : {"0", "-2", "many", "1.5", "99999999999"}) {
    setenv("LIGHTSTAGE_THREADS", text, 1);
    CHECK_THROWS_AS(core::thread_count(), core::UsageError);
  }
  unsetenv("LIGHTSTAGE_THREADS");
}
