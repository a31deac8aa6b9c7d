#include "capture/light_schedule.h"

#include <algorithm>
#include <optional>

#include "core/text.h"

namespace lightstage::capture {

namespace {

// Devices are never quite as was reckoned, and what the controllers stop is a pass broken off.
constexpr double kMargin = 0.97;

std::string number(double value) {
  return core::number_text(value, 2);
}

std::string step_text(const db::Step& step) {
  return "step " + std::to_string(step.step_index) + " (" + std::string(db::to_string(step.kind)) + ")";
}

// A store that fills by 1 - duty while the light is on and empties by duty while it is off (docs/led-protocol.md), and how long it has been on.
struct Heat {
  double store_s = 0, on_s = 0;
};

struct Hot {
  int light = 0;
  const db::Step* step = nullptr;
  bool on_time = false;  // else duty
};

std::optional<Hot> first_hot(const Sequence& sequence, const std::vector<std::vector<LightLevel>>& lit,
                             std::size_t light_count, const LightLimits& limits,
                             const std::vector<core::Nanoseconds>& times) {
  std::vector<Heat> heat(light_count);
  std::vector<bool> on(light_count);
  for (std::size_t i = 0; i < sequence.steps.size(); ++i) {
    const double seconds = double(times[i + 1] - times[i]) / core::kSecond;
    std::fill(on.begin(), on.end(), false);
    for (const LightLevel& level : lit[i]) {
      on[std::size_t(level.light_index)] = level.r > 0 || level.g > 0 || level.b > 0;
    }
    for (std::size_t l = 0; l < light_count; ++l) {
      heat[l].on_s = on[l] ? heat[l].on_s + seconds : 0;
      heat[l].store_s = std::max(0.0, heat[l].store_s + (on[l] ? 1 - limits.duty : -limits.duty) * seconds);
      if (limits.on_time_s > 0 && heat[l].on_s > limits.on_time_s) return Hot{int(l), &sequence.steps[i], true};
      if (limits.duty < 1 && heat[l].store_s > limits.duty * limits.duty_window_s)
        return Hot{int(l), &sequence.steps[i], false};
    }
  }
  return std::nullopt;
}

struct Flashing {
  core::Nanoseconds time = 0;
  const db::Step* step = nullptr;
  FlashMeter::Worst worst, worst_small;
};

std::optional<Flashing> first_flashing(const Sequence& sequence, const std::vector<std::vector<LightLevel>>& lit,
                                       std::size_t light_count, const LightLimits& limits,
                                       const std::vector<core::Nanoseconds>& times) {
  LightLimits with_margin = limits;
  if (limits.strobe_share < 1) with_margin.strobe_share *= kMargin;
  FlashMeter meter(light_count, with_margin);
  std::optional<Flashing> first;
  std::vector<LitLight> shown;
  for (std::size_t i = 0; i < sequence.steps.size(); ++i) {
    shown.clear();
    for (const LightLevel& level : lit[i]) {
      shown.push_back({std::size_t(level.light_index), {level.r, level.g, level.b}});
    }
    meter.show(times[i], shown);
    if (const auto time = first ? std::nullopt : meter.too_many(); time && *time < times[i + 1]) {
      first = Flashing{*time, &sequence.steps[i], {}, {}};
    }
  }
  meter.show(times.back(), {});
  if (first) first->worst = meter.worst();
  if (first) first->worst_small = meter.worst_small();
  return first;
}

}  // namespace

std::vector<Pace> possible_paces() {
  std::vector<Pace> paces;
  for (const int overhead_ms : {0, 1, 2, 4, 7, 12, 20, 35, 60, 100}) {
    for (const int rate : {1000, 200, 60, 30})
      paces.push_back({overhead_ms * core::kMillisecond, core::kSecond / rate});
  }
  return paces;
}

std::vector<core::Nanoseconds> light_times(const Sequence& sequence, const Pace& pace) {
  std::vector<core::Nanoseconds> times{0};
  core::Nanoseconds ready = 0;  // cameras, for the next trigger
  for (std::size_t i = 0; i < sequence.steps.size(); ++i) {
    const core::Nanoseconds exposure = sequence.steps[i].exposure_ns, lit = times.back();
    const core::Nanoseconds period = std::max(pace.period, exposure);
    const bool changes = i + 1 < sequence.steps.size() && sequence.steps[i + 1].exposure_ns != exposure;
    core::Nanoseconds off = 0;
    switch (sequence.timing) {
      case Timing::kLockstep: {
        const core::Nanoseconds trigger = std::max(lit + sequence.settle, ready);
        ready = trigger + period;
        off = trigger + exposure + pace.overhead;
        break;
      }
      case Timing::kPipelined: {
        // The strobe lights the next pattern. A run of steps of one exposure ends by waiting for its frames and settling once more, with the next lights on.
        const bool begins = i == 0 || sequence.steps[i - 1].exposure_ns != exposure;
        const core::Nanoseconds settled = lit + sequence.settle + (begins ? pace.overhead + sequence.settle : 0);
        const core::Nanoseconds trigger = std::max(settled, ready);
        ready = trigger + period;
        off = trigger + exposure + sequence.hold;
        break;
      }
      case Timing::kFreeRun:
        // An exposure begins within a period of the lights' settling. Before cameras expose otherwise the one under way and the next must end, and six
        // more tell where the exposures lie.
        off = lit + sequence.settle + period + exposure + pace.overhead + (changes ? 8 * pace.period : 0);
        break;
    }
    times.push_back(std::max(off, lit + 1));
  }
  return times;
}

std::vector<std::string> exceeded_limits(const Sequence& sequence, std::size_t light_count, const LightLimits& limits,
                                         std::span<const Pace> paces) {
  std::vector<std::vector<LightLevel>> lit;
  for (const db::Step& step : sequence.steps) lit.push_back(levels(step, light_count));
  std::optional<Flashing> flashing;
  std::optional<Hot> hot;
  for (const Pace& pace : paces) {
    const std::vector<core::Nanoseconds> times = light_times(sequence, pace);
    const auto found = first_flashing(sequence, lit, light_count, limits, times);
    if (found && (!flashing || found->worst.in_a_second > flashing->worst.in_a_second)) flashing = found;
    if (!hot) hot = first_hot(sequence, lit, light_count, limits, times);
  }
  std::vector<std::string> lines;
  if (flashing) {
    const int most = int(limits.strobe_from_hz), most_small = 3 * most;
    const bool large = flashing->worst.in_a_second > most, small = flashing->worst_small.in_a_second > most_small;
    const FlashMeter::Worst& worst = large ? flashing->worst : flashing->worst_small;
    const std::string how_often =
        large || small
            ? "the stage would flash " + std::to_string(worst.in_a_second) + " times within a second, by up to " +
                  number(100 * worst.rise) + " % of its full light (or of one of its colours) as an eye sees it"
            : "lights that make up " + number(100 * limits.strobe_area) + " % of the stage would flash more than " +
                  std::to_string(most) + " times within a second";
    lines.push_back(how_often + ", from " + step_text(*flashing->step) + " on, which can set off seizures: at most " +
                    std::to_string(most) + " flashes of " + number(100 * limits.strobe_share) + " % a second, or " +
                    std::to_string(most_small) + " of " + number(50 * limits.strobe_share) +
                    " %, are allowed ([limits] of the stage file)");
  }
  if (hot) {
    lines.push_back(
        "light " + std::to_string(hot->light) + " would be on " +
        (hot->on_time ? "for longer than " + number(limits.on_time_s) + " s without a break"
                      : "for more than " + number(100 * limits.duty) + " % of the time") +
        ", in " + step_text(*hot->step) +
        ": more heat than [limits] of the stage file allows; light it for shorter, or with pauses (dark steps)");
  }
  return lines;
}

}  // namespace lightstage::capture
