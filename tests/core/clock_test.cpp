#include "core/clock.h"

#include <catch2/catch.hpp>
#include <thread>
#include <vector>

#include "core/error.h"

using namespace lightstage;

TEST_CASE("the system clock sleeps until a time and not at all for one that has passed") {
  core::SystemClock clock;
  const core::Nanoseconds start = clock.now();
  clock.sleep_until(start + 5 * core::kMillisecond);
  CHECK(clock.now() >= start + 5 * core::kMillisecond);
  const core::Nanoseconds before = clock.now();
  clock.sleep_until(start);
  clock.sleep_until(-core::kSecond);
  CHECK(clock.now() - before < core::kSecond);
}

TEST_CASE("virtual time passes only by sleeping, and never backwards") {
  core::VirtualClock clock;
  CHECK(clock.now() == 0);
  clock.sleep_until(3600 * core::kSecond);
  CHECK(clock.now() == 3600 * core::kSecond);
  clock.sleep_until(5);
  CHECK(clock.now() == 3600 * core::kSecond);
  std::vector<std::thread> threads;
  for (int t = 1; t <= 4; ++t)
    threads.emplace_back([&clock, t] {
      for (int i = 0; i < 1000; ++i) clock.sleep_until(3600 * core::kSecond + i * 4 + t);
    });
  for (std::thread& t : threads) t.join();
  CHECK(clock.now() == 3600 * core::kSecond + 999 * 4 + 4);
}

TEST_CASE("time stamps are UTC in ISO 8601") {
  const std::string now = core::utc_timestamp();
  REQUIRE(now.size() == 20);
  CHECK(now[4] == '-');
  CHECK(now[10] == 'T');
  CHECK(now[13] == ':');
  CHECK(now.back() == 'Z');
  CHECK(now.substr(0, 2) == "20");
}

TEST_CASE("every kind of error has its exit code") {
  const auto code = [](const core::Error& error) { return core::exit_code(error.kind()); };
  CHECK(core::exit_code(core::ErrorKind::kInternal) == 1);
  CHECK(code(core::UsageError("")) == 2);
  CHECK(code(core::BadInput("")) == 3);
  CHECK(code(core::DeviceError("")) == 4);
  CHECK(code(core::StoreError("")) == 5);
  CHECK(code(core::Interrupted("")) == 130);
}
