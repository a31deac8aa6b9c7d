#include "capture/led_group.h"

#include <catch2/catch.hpp>
#include <random>

#include "core/error.h"

using namespace lightstage;
using capture::LedStatus;
using capture::LightLevel;

namespace {

using Patterns = std::vector<std::vector<LightLevel>>;

// What a member was told, and what it answers.
struct Told {
  std::vector<LightLevel> lit;
  bool broken = false, interrupted = false;
  int all_off_calls = 0;
  LedStatus status;
  bool plays = true;
  Patterns loaded;
  std::optional<std::size_t> armed;
  core::Nanoseconds delay = -1;
  std::optional<core::Nanoseconds> reaches;
};

class Member final : public capture::LedController, public capture::PatternPlayer {
 public:
  Member(std::string name, std::size_t lights, Told& told) : name_(std::move(name)), lights_(lights), told_(told) {}
  std::size_t light_count() const override { return lights_; }
  void show(std::span<const LightLevel> levels) override {
    check();
    for (const LightLevel& level : levels) REQUIRE(std::size_t(level.light_index) < lights_);
    told_.lit.assign(levels.begin(), levels.end());
  }
  void all_off() override {
    ++told_.all_off_calls;
    check();
    told_.lit.clear();
  }
  LedStatus status() override {
    check();
    return told_.status;
  }
  std::size_t position() override { return told_.armed.value_or(0); }
  PatternPlayer* player() override { return told_.plays ? this : nullptr; }
  void load(std::span<const std::vector<LightLevel>> patterns) override {
    check();
    told_.loaded.assign(patterns.begin(), patterns.end());
  }
  void arm(std::size_t first, core::Nanoseconds delay) override {
    check();
    told_.armed = first;
    told_.delay = delay;
  }
  std::optional<core::Nanoseconds> wait_for_pattern(std::size_t, core::Nanoseconds) override { return told_.reaches; }

 private:
  void check() const {
    if (told_.interrupted) throw core::Interrupted("interrupted");
    if (told_.broken) throw core::DeviceError(name_ + " is gone");
  }
  std::string name_;
  std::size_t lights_;
  Told& told_;
};

// Three members whose lights are shuffled over the group.
struct Bench {
  std::vector<Told> told = std::vector<Told>(3);
  std::vector<std::vector<int>> lights{{4, 0}, {1}, {5, 2, 3}};
  std::unique_ptr<capture::LedController> group;
  Bench() {
    std::vector<capture::LedGroupMember> members;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::string name(1, char('a' + i));
      members.push_back({name, std::make_unique<Member>(name, lights[i].size(), told[i]), lights[i]});
    }
    group = capture::make_led_group(std::move(members));
  }
  // What all members show together, in the group's numbering.
  std::vector<LightLevel> together(const auto& part_of) const {
    std::vector<LightLevel> all;
    for (std::size_t i = 0; i < 3; ++i) {
      for (LightLevel level : part_of(told[i])) {
        level.light_index = lights[i][std::size_t(level.light_index)];
        all.push_back(level);
      }
    }
    std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.light_index < b.light_index; });
    return all;
  }
};

std::vector<LightLevel> random_pattern(std::mt19937& random) {
  std::vector<LightLevel> pattern;
  for (int i = 0; i < 6; ++i) {
    if (random() % 2 == 0) pattern.push_back({i, float(random() % 5) / 4, 1, float(i) / 8});
  }
  return pattern;
}

}  // namespace

TEST_CASE("a group of controllers shows what one would show", "[led_group]") {
  Bench bench;
  CHECK(bench.group->light_count() == 6);
  std::mt19937 random(3);
  for (int i = 0; i < 100; ++i) {
    const std::vector<LightLevel> pattern = random_pattern(random);
    bench.group->show(pattern);  // members without a part of it must go dark
    REQUIRE(bench.together([](const Told& t) { return t.lit; }) == pattern);
  }
}

TEST_CASE("a member that fails keeps no other from its part", "[led_group]") {
  Bench bench;
  bench.group->show(std::vector<LightLevel>{{4}, {1}, {5}});
  bench.told[0].broken = bench.told[1].broken = true;
  CHECK_THROWS_WITH(bench.group->show(std::vector<LightLevel>{{2}}), "a is gone; b is gone");
  CHECK(bench.told[2].lit == std::vector<LightLevel>{{1}});
  CHECK_THROWS_WITH(bench.group->all_off(), "a is gone; b is gone");
  CHECK(bench.told[2].lit.empty());
  for (const Told& told : bench.told) CHECK(told.all_off_calls == 1);

  bench.told[0].interrupted = true;
  CHECK_THROWS_AS(bench.group->all_off(), core::Interrupted);
  CHECK(bench.told[2].all_off_calls == 2);
}

TEST_CASE("a group's status is that of its worst member", "[led_group]") {
  Bench bench;
  CHECK_FALSE(bench.group->status().temperature_celsius);
  CHECK_FALSE(bench.group->status().supply_volts);
  bench.told[0].status = {41, 23.5, {}};
  bench.told[1].status = {{}, {}, {"light 0 is open"}};
  bench.told[2].status = {55, 24, {"too hot", "fan stands"}};
  const LedStatus status = bench.group->status();
  CHECK(status.temperature_celsius == 55);
  CHECK(status.supply_volts == 23.5);
  CHECK(status.faults == std::vector<std::string>{"b: light 0 is open", "c: too hot", "c: fan stands"});
}

TEST_CASE("a group plays sequences when all its members do", "[led_group]") {
  Bench bench;
  bench.told[1].plays = false;
  CHECK(bench.group->player() == nullptr);
  bench.told[1].plays = true;
  capture::PatternPlayer* player = bench.group->player();
  REQUIRE(player != nullptr);

  std::mt19937 random(4);
  Patterns patterns;
  for (int i = 0; i < 50; ++i) patterns.push_back(random_pattern(random));
  player->load(patterns);
  for (std::size_t i = 0; i < patterns.size(); ++i) {
    REQUIRE(bench.together([i](const Told& t) { return t.loaded.at(i); }) == patterns[i]);
  }
  player->arm(7, 250);
  for (const Told& told : bench.told) {
    CHECK(told.armed == 7u);
    CHECK(told.delay == 250);
  }

  CHECK_FALSE(player->wait_for_pattern(1, 0));
  bench.told[0].reaches = 10;
  bench.told[2].reaches = 8;
  CHECK_FALSE(player->wait_for_pattern(1, 0));
  bench.told[1].reaches = 12;
  CHECK(player->wait_for_pattern(1, 0) == 12);

  bench.told[2].broken = true;
  CHECK_THROWS_WITH(player->arm(3, 0), "c is gone");
  CHECK(bench.told[0].armed == 3u);
}
