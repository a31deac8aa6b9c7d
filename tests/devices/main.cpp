// Makes every call of every device fail in every way, and then calls at random, and looks whether a frame was ever stored under a light that it does not
// show: `./run devices`.
#include <algorithm>
#include <iostream>
#include <random>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/progress.h"
#include "devices/trial.h"

namespace lightstage::devices {
namespace {

using nlohmann::ordered_json;
using sim::DeviceCall;
using sim::DeviceFault;

struct Tally {
  int trials = 0, injected = 0, survived = 0, gave_up = 0, lights_left_on = 0;
  std::size_t wrong = 0, missing = 0;

  void add(const Trial& trial, const std::string& what) {
    ++trials;
    injected += trial.injected;
    survived += trial.survived() ? trial.injected : 0;
    gave_up += trial.gave_up;
    lights_left_on += trial.lights_left_on ? 1 : 0;
    wrong += trial.wrong;
    missing += trial.missing;
    for (const std::string& complaint : trial.complaints) std::cerr << what << ": " << complaint << "\n";
    if (trial.wrong > 0) std::cerr << what << ": " << trial.wrong << " frames of another light\n";
    if (trial.missing > 0) std::cerr << what << ": " << trial.missing << " frames missing\n";
    if (trial.lights_left_on) std::cerr << what << ": lights left on\n";
  }
  ordered_json json() const {
    return {{"trials", trials},
            {"injected", injected},
            {"survived", survived},
            {"gave_up_and_resumed", gave_up},
            {"wrong", wrong},
            {"missing", missing},
            {"lights_left_on", lights_left_on}};
  }
};

// Each fault at calls early and late, twice and in a row; and at every call from one on, until the devices are mended.
Tally matrix(Bench& bench) {
  Tally tally;
  std::size_t cells = 0;
  for (const DeviceCall call : sim::kDeviceCalls) {
    for (const DeviceFault fault : sim::kDeviceFaults) cells += sim::can_befall(fault, call) ? 1 : 0;
  }
  core::Progress progress("every call, every fault", cells * capture::kTimings.size());
  for (const capture::Timing timing : capture::kTimings) {
    for (const DeviceCall call : sim::kDeviceCalls) {
      for (const DeviceFault fault : sim::kDeviceFaults) {
        if (!sim::can_befall(fault, call)) continue;
        progress.advance();
        const std::string what =
            std::string(to_string(timing)) + ", " + std::string(to_string(call)) + ", " + std::string(to_string(fault));
        const auto at = [&](std::vector<int> calls) {
          return [=](DeviceCall c, int n) {
            const bool hit = c == call && std::find(calls.begin(), calls.end(), n) != calls.end();
            return hit ? std::optional(fault) : std::nullopt;
          };
        };
        const auto from = [&](int first) {
          return [=](DeviceCall c, int n) { return c == call && n >= first ? std::optional(fault) : std::nullopt; };
        };
        tally.add(bench.run(timing, at({0, 5, 14, 15})), what + ", now and then");
        tally.add(bench.run(timing, from(7)), what + ", from one on");
      }
    }
  }
  return tally;
}

// Any fault at any call, each with a chance of some percent, until so many have happened.
Tally soak(Bench& bench, int points, std::uint64_t seed) {
  Tally tally;
  std::mt19937_64 random(seed);
  core::Progress progress("faults at random", std::size_t(points));
  while (tally.injected < points) {
    const std::uint64_t pass_seed = random();
    std::mt19937_64 own(pass_seed);
    const capture::Timing timing = capture::kTimings[own() % capture::kTimings.size()];
    const double chance = 0.002 + 0.03 * double(own() % 1000) / 1000;
    const auto plan = [&](DeviceCall call, int) -> std::optional<DeviceFault> {
      if (double(own() >> 11) * 0x1p-53 > chance) return std::nullopt;
      const DeviceFault fault = sim::kDeviceFaults[own() % sim::kDeviceFaults.size()];
      // For good seldom: nothing happens after it.
      if (fault == DeviceFault::kVanishForGood && own() % 4 != 0) return std::nullopt;
      return can_befall(fault, call) ? std::optional(fault) : std::nullopt;
    };
    const Trial trial = bench.run(timing, plan);
    tally.add(trial, std::string(to_string(timing)) + ", pass " + std::to_string(pass_seed));
    progress.advance(std::size_t(std::max(0, trial.injected)));
  }
  return tally;
}

int run(int argc, char** argv) {
  CLI::App app("Devices that fail, in every way and at random.", "device_faults");
  int points = 300;
  std::uint64_t seed = 1;
  bool with_matrix = true;
  app.add_option("--points", points, "Faults at random, besides the matrix of all calls and faults")
      ->capture_default_str()
      ->check(CLI::Range(0, 100000000));
  app.add_option("--seed", seed, "Which")->capture_default_str();
  app.add_flag("!--no-matrix", with_matrix, "Only those at random");
  CLI11_PARSE(app, argc, argv);
  Bench bench;
  if (bench.least_difference() < 3 * Bench::kTolerance) {
    std::cerr << "device_faults: lights cannot be told apart by their pictures (" << bench.least_difference() << ")\n";
    return 1;
  }
  Tally all_calls, at_random;
  if (with_matrix) all_calls = matrix(bench);
  if (points > 0) at_random = soak(bench, points, seed);
  const int injected = all_calls.injected + at_random.injected, survived = all_calls.survived + at_random.survived;
  std::cout << ordered_json{{"injected", injected},
                            {"survived", survived},
                            {"wrong", all_calls.wrong + at_random.wrong},
                            {"matrix", all_calls.json()},
                            {"random", at_random.json()}}
                   .dump()
            << std::endl;
  return survived == injected ? 0 : 1;
}

}  // namespace
}  // namespace lightstage::devices

int main(int argc, char** argv) {
  try {
    lightstage::core::set_quiet(true);
    return lightstage::devices::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "device_faults: " << error.what() << "\n";
    return 1;
  }
}
