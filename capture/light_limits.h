// What the lights of a stage may do: to those who see them, and to themselves.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "core/clock.h"

namespace lightstage::capture {

// [limits] of a stage file. The program refuses sequences that exceed them, and controllers keep theirs at exact times.
//
// Flashing light between about 3 and 60 times a second can set off seizures. What counts follows the rules that broadcasters and web pages keep: a flash is a pair
// of opposing changes of luminance by a tenth of the most there is, or more, and no more than three may fall into any second over a quarter of
// the field of view (WCAG 2.3.1; ITU-R BT.1702, with 20 cd/m2 of 200; IEEE 1789-2015 has the risk of seizures from 3 to 70 Hz). A stage is much
// brighter than a screen: `strobe_share` is what its owner answers for.
struct LightLimits {
  double strobe_from_hz = 3, strobe_to_hz = 60;  // the band; so many flashes in any second are the most, rounded down
  double strobe_share = 0.1;  // of a light's, or the stage's, full light: smaller changes are no flashes; 1: nothing is
  double strobe_area = 0.25;  // share of the lights that flash too often, from which on that is refused

  // Heat, as in docs/led-protocol.md: a light is on for no more than duty * (T + window) in any time T, and never for longer than on_time without a break.
  double duty = 1;            // 1: no limit
  double duty_window_s = 20;  // seconds
  double on_time_s = 0;       // 0: no limit
  friend bool operator==(const LightLimits&, const LightLimits&) = default;
};

// A light that is on: each of its colours from 0 to 1 of what it can give.
struct LitLight {
  std::size_t light = 0;
  std::array<double, 3> rgb{};
};

// How many flashes an onlooker has seen of changing lights, and when they become too many.
//
// An eye does not follow light at once. What it sees is modelled by a first-order low-pass (Bloch's law of temporal summation, for short flashes; flicker
// fusion, for fast ones), whose time constant makes all lights going on and off at `strobe_to_hz`, half of the time each, swing by a tenth. So 2 ms of full light count as
// a twentieth of it, and light that flickers faster than the band as steady. A flash begins when what is seen has risen by strobe_share above its lowest value
// since it last fell by as much. Too many are: more than strobe_from_hz beginnings within a second of the sum of all lights, or of each of so many lights as make up strobe_area.
// Eyes mind flicker most at 15 to 25 Hz, so three times as many flashes of half that share are too many as well.
//
// Six views of a light's colours are looked at so, of which the worst counts: each colour by itself, of what it can give; their mean and their maximum (of colours that take turns); and
// saturated red, which is the more dangerous: r - g - b where red is four fifths of the light or more, of which five eighths of strobe_share are a flash (WCAG 2.3.1 has 20/320 for it, where it
// has a tenth for luminance; ITU-R BT.1702 bars it altogether).
class FlashMeter {
 public:
  FlashMeter(std::size_t lights, const LightLimits& limits);

  // From `now` on, which must not go back, these lights are on as said; those not named are dark. O(lights).
  void show(core::Nanoseconds now, std::span<const LitLight> lit);
  // When flashes are too many if the lights stay as they are: now or later; nothing if never.
  std::optional<core::Nanoseconds> too_many() const;

  // Flashes of all lights together so far, in the worst view: the most beginnings within one second, at most one more than may be, and the largest share of full light by which they rose.
  struct Worst {
    int in_a_second = 0;
    double rise = 0;
  };
  const Worst& worst() const { return worst_[0]; }
  const Worst& worst_small() const { return worst_[1]; }  // of those of half the share

 private:
  struct Signal {
    double level = 0, seen = 0;  // what it is now, and what an eye saw of it at time_
    double extreme = 0;          // the lowest since it fell, or the highest since it rose
    bool high = false;
    std::vector<core::Nanoseconds> flashes;  // the newest, oldest first; at most one more than may be
  };
  // A light, or all of them. The views of one that has been nothing but white are one.
  struct Source {
    std::vector<Signal> signals;  // each view for large and for small flashes
  };
  struct Rule {
    double share = 0;
    std::size_t most = 0;  // in a second
  };
  Rule rule(std::size_t signal) const;
  static void set(Source& source, std::span<const double> levels);
  std::optional<core::Nanoseconds> next_flash(const Signal& signal, const Rule& rule) const;
  void advance(Signal& signal, const Rule& rule, core::Nanoseconds to, double decay) const;
  // Whether a flash at this time would be one too many, and until when it counts as that.
  static std::optional<core::Nanoseconds> too_many_until(const Signal& signal, const Rule& rule,
                                                         core::Nanoseconds flash);

  LightLimits limits_;
  std::size_t most_;  // flashes in a second
  double eye_ns_;     // the time constant
  core::Nanoseconds time_ = 0;
  Source all_;  // the mean of the lights
  std::vector<Source> lights_;
  std::array<Worst, 2> worst_;
};

}  // namespace lightstage::capture
