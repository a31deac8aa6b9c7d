#include "capture/v4l2/sequence_counter.h"

#include <catch2/catch.hpp>
#include <random>

using lightstage::capture::SequenceCounter;

TEST_CASE("a wrap of the driver's 32 bits is a step like any other", "[v4l2]") {
  SequenceCounter counter;
  const std::int64_t first = counter.number_of(0xfffffffe);
  CHECK(counter.number_of(0xffffffff) == first + 1);
  CHECK(counter.number_of(0) == first + 2);
  CHECK(counter.number_of(1) == first + 3);
}

TEST_CASE("gaps, repeats and steps back stay visible, across a wrap too", "[v4l2]") {
  SequenceCounter counter;
  const std::int64_t first = counter.number_of(0xfffffff0);
  CHECK(counter.number_of(0x10) == first + 0x20);
  CHECK(counter.number_of(0x10) == first + 0x20);
  CHECK(counter.number_of(0xfffffff8) == first + 8);
  CHECK(counter.number_of(0x11) == first + 0x21);
}

TEST_CASE("numbers of a stream that starts anew lie above all earlier ones", "[v4l2]") {
  SequenceCounter counter;
  counter.number_of(7);
  const std::int64_t highest = counter.number_of(19);
  counter.number_of(12);
  counter.restart();
  CHECK(counter.number_of(0) == highest + 1);
  CHECK(counter.number_of(1) == highest + 2);
}

TEST_CASE("any true count is followed over several wraps, whatever is lost or repeated", "[v4l2]") {
  std::mt19937_64 random(3);
  SequenceCounter counter;
  std::int64_t truth = 0xfffff000, previous = truth;
  std::int64_t number = counter.number_of(static_cast<std::uint32_t>(truth));
  for (int i = 0; i < 100'000; ++i) {
    truth += static_cast<std::int64_t>(random() % 3'000'000) - 500'000;
    const std::int64_t next = counter.number_of(static_cast<std::uint32_t>(truth));
    REQUIRE(next - number == truth - previous);
    number = next;
    previous = truth;
  }
  CHECK(truth > 8 * (std::int64_t(1) << 32));
}
