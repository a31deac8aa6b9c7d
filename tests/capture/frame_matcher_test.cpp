#include "capture/session/frame_matcher.h"

#include <catch2/catch.hpp>
#include <random>

using namespace lightstage;
using capture::CameraFrame;
using capture::FreeRunMatcher;
using capture::Latency;
using capture::MatchedFrame;
using capture::StampLine;
using capture::TriggeredMatcher;
using core::kMillisecond;
using core::Nanoseconds;

namespace {

// The step that the frame really shows is its picture's only pixel; -1 where it shows none or more than one.
CameraFrame frame(int shows, std::int64_t number, Nanoseconds stamp) {
  core::Image image(1, 1, 1);
  image(0, 0) = static_cast<float>(shows);
  return {std::move(image), 1, number, stamp, false};
}

int shown(const MatchedFrame& matched) {
  return static_cast<int>(matched.frame.image(0, 0));
}

struct Dice {
  std::mt19937_64 random;
  explicit Dice(std::uint64_t seed) : random(seed) {}
  bool chance(int percent) { return static_cast<int>(random() % 100) < percent; }
  Nanoseconds up_to(Nanoseconds most) {
    return static_cast<Nanoseconds>(random() % static_cast<std::uint64_t>(most + 1));
  }
};

}  // namespace

TEST_CASE("triggered frames without faults are all matched", "[matcher]") {
  TriggeredMatcher matcher({5 * kMillisecond, 9 * kMillisecond});
  for (int i = 0; i < 20; ++i) {
    const Nanoseconds time = i * 10 * kMillisecond;
    matcher.expect(i, time, time + kMillisecond / 2);
    matcher.add(frame(i, 40 + i, time + 6 * kMillisecond + (i % 3) * kMillisecond));
  }
  CHECK(matcher.outstanding() == 0);
  const std::vector<MatchedFrame> matched = matcher.close();
  REQUIRE(matched.size() == 20);
  for (int i = 0; i < 20; ++i)
    CHECK((matched[static_cast<std::size_t>(i)].step == i && shown(matched[static_cast<std::size_t>(i)]) == i));
}

TEST_CASE("a triggered frame whose stamp fits two exposures is given to neither", "[matcher]") {
  TriggeredMatcher matcher({0, 12 * kMillisecond});
  matcher.expect(0, 0, 0);
  matcher.expect(1, 10 * kMillisecond, 10 * kMillisecond);
  matcher.add(frame(0, 1, 11 * kMillisecond));
  CHECK(matcher.close().empty());
}

TEST_CASE("two triggered frames for one exposure are both refused", "[matcher]") {
  TriggeredMatcher matcher({0, 4 * kMillisecond});
  for (int i = 0; i < 3; ++i) matcher.expect(i, i * 10 * kMillisecond, i * 10 * kMillisecond);
  matcher.add(frame(0, 1, 1 * kMillisecond));
  matcher.add(frame(1, 2, 22 * kMillisecond));  // of exposure 1, stamped far too late
  matcher.add(frame(2, 3, 23 * kMillisecond));
  const std::vector<MatchedFrame> matched = matcher.close();
  REQUIRE(matched.size() == 1);
  CHECK(matched[0].step == 0);
}

TEST_CASE("a triggered frame that took the place of a lost one is known by its number", "[matcher]") {
  TriggeredMatcher matcher({0, 4 * kMillisecond});
  for (int i = 0; i < 3; ++i) matcher.expect(i, i * 10 * kMillisecond, i * 10 * kMillisecond);
  matcher.add(frame(0, 1, 1 * kMillisecond));
  matcher.add(frame(1, 2, 22 * kMillisecond));  // as before, and the frame of exposure 2 never comes
  CHECK(matcher.outstanding() == 1);
  const std::vector<MatchedFrame> matched = matcher.close();
  REQUIRE(matched.size() == 1);
  CHECK(shown(matched[0]) == 0);
}

TEST_CASE("a triggered camera's lost frame is noticed with the next one, where its count leaves it out", "[matcher]") {
  TriggeredMatcher matcher({0, 4 * kMillisecond});
  for (int i = 0; i < 3; ++i) matcher.expect(i, i * 10 * kMillisecond, i * 10 * kMillisecond);
  matcher.add(frame(0, 7, 1 * kMillisecond));
  CHECK_FALSE(matcher.lost_count());
  matcher.add(frame(2, 8, 21 * kMillisecond));
  CHECK(matcher.lost_count());
  const std::vector<MatchedFrame> matched = matcher.close();
  REQUIRE(matched.size() == 1);
  CHECK(matched[0].step == 0);
}

TEST_CASE("whatever a triggered camera does, no frame is matched to another step", "[matcher]") {
  std::size_t right = 0, asked = 0;
  for (std::uint64_t seed = 0; seed < 3000; ++seed) {
    CAPTURE(seed);
    Dice dice(seed);
    const Latency latency{dice.up_to(20 * kMillisecond), 0};
    const Nanoseconds spread = kMillisecond / 2 + dice.up_to(8 * kMillisecond);
    const Latency bounds{latency.least, latency.least + spread};
    TriggeredMatcher matcher(bounds);
    std::int64_t number = static_cast<std::int64_t>(dice.up_to(1000));
    Nanoseconds time = dice.up_to(core::kSecond);
    const bool counts_what_it_swallows = dice.chance(50);
    std::vector<CameraFrame> arriving;
    const int steps = 1 + static_cast<int>(dice.up_to(30));
    for (int i = 0; i < steps; ++i) {
      const Nanoseconds fire = dice.up_to(kMillisecond / 3);
      matcher.expect(i, time, time + fire);
      ++asked;
      if (dice.chance(8)) {  // the trigger is not obeyed
        if (counts_what_it_swallows) ++number;
      } else {
        const Nanoseconds start = time + dice.up_to(fire);
        const std::int64_t mine = number++;
        if (!dice.chance(8)) {  // not lost on the way
          CameraFrame made = frame(i, mine, start + bounds.least + dice.up_to(spread));
          made.damaged = dice.chance(5);
          if (made.damaged) made.image(0, 0) = -1;
          arriving.push_back(made);
          if (dice.chance(8)) arriving.push_back(made);
        }
      }
      // As the pipelined mode paces: never nearer than the uncertainty of the stamps.
      time += spread + kMillisecond + dice.up_to(20 * kMillisecond);
    }
    for (CameraFrame& made : arriving) matcher.add(std::move(made));
    for (const MatchedFrame& matched : matcher.close()) {
      REQUIRE(shown(matched) == matched.step);
      ++right;
    }
  }
  // Caution must not mean that nothing is ever matched.
  CHECK(right > asked * 4 / 10);
}

TEST_CASE("single stamps beyond all bounds cost frames, not truth", "[matcher]") {
  std::size_t right = 0;
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    CAPTURE(seed);
    Dice dice(seed);
    const Nanoseconds period = 10 * kMillisecond;
    TriggeredMatcher matcher({0, 5 * kMillisecond});
    const int late = 3 + static_cast<int>(dice.up_to(10)), lost = 3 + static_cast<int>(dice.up_to(10));
    for (int i = 0; i < 20; ++i) {
      matcher.expect(i, i * period, i * period);
      if (i == lost) continue;
      const Nanoseconds by = i == late ? dice.up_to(40 * kMillisecond) : 0;
      matcher.add(frame(i, i, i * period + dice.up_to(4 * kMillisecond) + by));
    }
    for (const MatchedFrame& matched : matcher.close()) {
      REQUIRE(shown(matched) == matched.step);
      ++right;
    }
  }
  CHECK(right > 2000 * 6);
}

TEST_CASE("a stamp line knows when the next exposure is", "[matcher]") {
  StampLine line(10 * kMillisecond);
  CHECK_FALSE(line.next_stamp(0));
  for (int i = -3; i < 2; ++i) CHECK_FALSE(line.note(frame(0, 100 + i, 7 * kMillisecond + i * 10 * kMillisecond)));
  CHECK_FALSE(line.next_stamp(0));
  CHECK(line.note(frame(0, 102, 27 * kMillisecond)) == 0);
  CHECK(line.next_stamp(27 * kMillisecond) == 27 * kMillisecond);
  CHECK(line.next_stamp(27 * kMillisecond + 1) == 37 * kMillisecond);
  CHECK(line.next_stamp(-13 * kMillisecond) == -13 * kMillisecond);
  CHECK(line.next_stamp(-13 * kMillisecond - 1) == -13 * kMillisecond);
  // A late one is told, and does not bend the line.
  CHECK(line.note(frame(0, 103, 41 * kMillisecond)) == 4 * kMillisecond);
  CHECK(line.note(frame(0, 105, 57 * kMillisecond)) == 0);
}

TEST_CASE("whatever a free-running camera does, no frame is matched to another step", "[matcher]") {
  std::size_t right = 0, asked = 0;
  for (std::uint64_t seed = 0; seed < 3000; ++seed) {
    CAPTURE(seed);
    Dice dice(seed);
    const Nanoseconds period = 8 * kMillisecond + dice.up_to(30 * kMillisecond);
    const Nanoseconds exposure = kMillisecond / 10 + dice.up_to(period - kMillisecond / 10);
    const Nanoseconds least = dice.up_to(40 * kMillisecond), jitter = dice.up_to(3 * kMillisecond);
    const Nanoseconds tolerance = kMillisecond + 2 * jitter;
    FreeRunMatcher matcher;
    matcher.change(0, exposure, period, {least, least + jitter}, tolerance, 0);

    // Exposures begin at phase + n * period. Lights change at times known to within the asking.
    const Nanoseconds phase = dice.up_to(period);
    struct Lit {
      Nanoseconds from, to;
    };
    std::vector<Lit> lights;
    Nanoseconds time = 8 * period;
    const int steps = 1 + static_cast<int>(dice.up_to(20));
    for (int i = 0; i < steps; ++i) {
      const Nanoseconds asked_at = time;
      const Nanoseconds lit = asked_at + dice.up_to(2 * kMillisecond);
      const Nanoseconds off = lit + exposure + dice.up_to(3 * period + 2 * tolerance + 2 * jitter);
      lights.push_back({lit, off});
      matcher.lit(i, lit, off - exposure);
      ++asked;
      time = off;
    }
    const auto truly_shows = [&](Nanoseconds start) {
      for (std::size_t i = 0; i < lights.size(); ++i) {
        if (start >= lights[i].from && start + exposure <= lights[i].to) return static_cast<int>(i);
      }
      return -1;
    };
    std::int64_t number = static_cast<std::int64_t>(dice.up_to(100));
    const bool counts_lost = dice.chance(50);
    Nanoseconds burst = 0;
    for (Nanoseconds start = phase; start < time + 3 * period; start += period) {
      const std::int64_t mine = number++;
      if (dice.chance(5)) {
        if (!counts_lost) --number;
        continue;
      }
      // Now and then stamps come late, far beyond what was measured, for a few frames.
      if (burst == 0 && dice.chance(2)) burst = 1 + dice.up_to(3);
      const Nanoseconds late = burst > 0 ? dice.up_to(100 * kMillisecond) : 0;
      if (burst > 0) --burst;
      CameraFrame made = frame(truly_shows(start), mine, start + least + dice.up_to(jitter) + late);
      if (dice.chance(5)) matcher.add(made);
      matcher.add(std::move(made));
    }
    // Closed in two goes, as in a pass.
    for (const Nanoseconds now : {time / 2, time + core::kSecond}) {
      for (const MatchedFrame& matched : matcher.close(now).matched) {
        REQUIRE(shown(matched) == matched.step);
        ++right;
      }
    }
  }
  CHECK(right > asked * 3 / 10);
}
