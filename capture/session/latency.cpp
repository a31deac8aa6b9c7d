#include "capture/session/latency.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "core/error.h"
#include "core/interrupt.h"

namespace lightstage::capture {

namespace {

constexpr int kTriggeredFrames = 6;  // the second half lit: one flash
constexpr int kFlashes = 8;
// The whole stage must not flash faster than 3 times a second: that can set off seizures (ITU-R BT.1702).
constexpr core::Nanoseconds kFlashLeast = 170 * core::kMillisecond;
constexpr core::Nanoseconds kLeastTolerance = 1 * core::kMillisecond;
constexpr core::Nanoseconds kInterruptDelay = 50 * core::kMillisecond;  // that Ctrl-C may take
constexpr core::Nanoseconds kSearchFrom = -50 * core::kMillisecond, kSearchTo = 500 * core::kMillisecond,
                            kSearchStep = core::kMillisecond / 5;

[[noreturn]] void fail(const CameraFeed& feed, const std::string& problem) {
  throw core::DeviceError("camera '" + feed.name() + "' cannot be timed: " + problem);
}

// How much later than any that was seen frames may come, where those took so long.
core::Nanoseconds spare(core::Nanoseconds longest) {
  return longest / 2 + core::kMillisecond;
}

std::vector<LightLevel> all_lights(const Pass& pass, float level) {
  std::vector<LightLevel> all;
  const int count = static_cast<int>(pass.rig().lights.light_count());
  for (int i = 0; i < count; ++i) all.push_back({i, level, level, level});
  return all;
}

// When the lights were switched: certainly not before `asked`, certainly done at `done`.
struct Switching {
  core::Nanoseconds asked = 0, done = 0;
  bool lit = false;
};

Switching switch_lights(Pass& pass, bool lit, float level = 1) {
  const core::Nanoseconds asked = pass.now();
  pass.rig().lights.show(lit ? all_lights(pass, level) : std::vector<LightLevel>{});
  pass.rig().clock.sleep_until(pass.now() + pass.sequence().settle);
  return {asked, pass.now(), lit};
}

struct SeenFrame {
  core::Nanoseconds timestamp = 0;
  double mean = 0;
};

// More than a hundredth of its values at the sensor's limit.
bool clips(const CameraFrame& frame) {
  const std::span<const float> values = frame.image.values();
  const auto clipped =
      std::count_if(values.begin(), values.end(), [&](float v) { return double(v) >= 0.98 * frame.saturation; });
  return frame.saturation > 0 && 100 * static_cast<std::size_t>(clipped) > values.size();
}

// The least and the greatest share of an exposure that began at `start` in which the lights were on.
std::pair<double, double> lit_share(const std::vector<Switching>& switchings, core::Nanoseconds start,
                                    core::Nanoseconds exposure) {
  const auto overlap = [&](core::Nanoseconds from, core::Nanoseconds to) {
    const core::Nanoseconds length = std::min(to, start + exposure) - std::max(from, start);
    return static_cast<double>(std::max<core::Nanoseconds>(0, length)) / static_cast<double>(exposure);
  };
  double least = 0, most = 0;
  for (std::size_t i = 0; i < switchings.size(); ++i) {
    if (!switchings[i].lit) continue;
    const bool last = i + 1 == switchings.size();
    const core::Nanoseconds never = std::numeric_limits<core::Nanoseconds>::max() / 2;
    least += overlap(switchings[i].done, last ? never : switchings[i + 1].asked);
    most += overlap(switchings[i].asked, last ? never : switchings[i + 1].done);
  }
  return {least, std::min(most, 1.0)};
}

Brightness brightness_of(const std::vector<SeenFrame>& frames) {
  const auto [darkest, brightest] =
      std::minmax_element(frames.begin(), frames.end(), [](const auto& a, const auto& b) { return a.mean < b.mean; });
  return {darkest->mean, brightest->mean};
}

// How many frames this latency explains.
std::size_t explained(const std::vector<SeenFrame>& frames, const std::vector<Switching>& switchings,
                      const Brightness& brightness, core::Nanoseconds exposure, core::Nanoseconds latency) {
  constexpr double kSlack = 0.05;  // lights that rise slowly, noise
  const auto fits = [&](const SeenFrame& frame) {
    const double share = (frame.mean - brightness.dark) / (brightness.full - brightness.dark);
    const auto [least, most] = lit_share(switchings, frame.timestamp - latency, exposure);
    return share >= least - kSlack && share <= most + kSlack;
  };
  return static_cast<std::size_t>(std::count_if(frames.begin(), frames.end(), fits));
}

// The latencies that explain the most frames.
Latency best_latency(const CameraFeed& feed, const std::vector<SeenFrame>& frames,
                     const std::vector<Switching>& switchings, const Brightness& brightness,
                     core::Nanoseconds exposure) {
  std::size_t most = 0;
  Latency best;
  for (core::Nanoseconds latency = kSearchFrom; latency <= kSearchTo; latency += kSearchStep) {
    const std::size_t count = explained(frames, switchings, brightness, exposure, latency);
    if (count > most) best = {latency, latency};
    if (count == most && latency == best.most + kSearchStep) best.most = latency;
    most = std::max(most, count);
  }
  if (4 * most < 3 * frames.size()) {
    fail(feed, "its frames do not follow the lights (" + std::to_string(most) + " of " + std::to_string(frames.size()) +
                   " explained by any delay of their time stamps)");
  }
  return {best.least - kSearchStep, best.most + kSearchStep};
}

}  // namespace

double mean_value(const core::Image& image) {
  double sum = 0;
  for (const float value : image.values()) sum += static_cast<double>(value);
  return image.values().empty() ? 0 : sum / static_cast<double>(image.values().size());
}

std::map<core::Nanoseconds, Brightness> brightness_of(const std::map<core::Nanoseconds, Reference>& references,
                                                      std::size_t camera) {
  std::map<core::Nanoseconds, Brightness> brightness;
  for (const auto& [exposure, reference] : references) {
    brightness.emplace(exposure, reference.cameras[camera].brightness);
  }
  return brightness;
}

Reference measure_triggered(Pass& pass, core::Nanoseconds exposure) {
  struct Seen {
    Latency stamp{std::numeric_limits<core::Nanoseconds>::max(), std::numeric_limits<core::Nanoseconds>::min()};
    core::Nanoseconds under_way = 0;  // after the stamp
    Brightness sum;
    int dark = 0, full = 0;
  };
  std::vector<CameraFeed>& feeds = pass.feeds();
  std::vector<Seen> seen(feeds.size());
  Reference reference;
  Switching switched;
  for (int i = 0; i < kTriggeredFrames; ++i) {
    core::throw_if_interrupted();
    const bool lit = i >= kTriggeredFrames / 2;
    if (i == 0 || i == kTriggeredFrames / 2) switched = switch_lights(pass, lit);
    for (CameraFeed& feed : feeds) {
      feed.set_exposing(Exposing::kTriggered);
      feed.set_exposure(exposure);
      feed.flush(pass.now());
    }
    const auto [called, triggered] = pass.trigger();
    reference.longest_trigger = std::max(reference.longest_trigger, triggered - called);
    for (std::size_t c = 0; c < feeds.size(); ++c) {
      const auto result = feeds[c].receive(called, called + exposure + pass.options().frame_timeout);
      if (!result.frame) continue;
      const core::Nanoseconds stamp = result.frame->timestamp;
      seen[c].stamp = {std::min(seen[c].stamp.least, stamp - triggered), std::max(seen[c].stamp.most, stamp - called)};
      seen[c].under_way = std::max(seen[c].under_way, pass.now() - stamp);
      (lit ? seen[c].sum.full : seen[c].sum.dark) += mean_value(result.frame->image);
      ++(lit ? seen[c].full : seen[c].dark);
    }
  }
  // What follows may begin with all lights.
  const core::Nanoseconds next_flash = switched.asked + 2 * kFlashLeast;
  switch_lights(pass, false);
  pass.rig().clock.sleep_until(next_flash);
  for (std::size_t c = 0; c < feeds.size(); ++c) {
    const int came = seen[c].dark + seen[c].full;
    if (seen[c].dark == 0 || seen[c].full == 0 || came < 3) {
      fail(feeds[c], "of " + std::to_string(kTriggeredFrames) + " triggered frames " + std::to_string(came) + " came");
    }
    CameraReference camera;
    camera.latency = seen[c].stamp;
    camera.arrival = seen[c].under_way + spare(camera.latency.most + seen[c].under_way);
    camera.tolerance = kLeastTolerance + camera.latency.range() / 2;
    camera.latency.least -= camera.tolerance;
    camera.latency.most += camera.tolerance;
    camera.brightness = {seen[c].sum.dark / seen[c].dark, seen[c].sum.full / seen[c].full};
    reference.cameras.push_back(camera);
  }
  return reference;
}

Reference measure_free_running(Pass& pass, core::Nanoseconds exposure) {
  std::vector<CameraFeed>& feeds = pass.feeds();
  core::Nanoseconds period = 0;
  for (CameraFeed& feed : feeds) {
    feed.set_exposing(Exposing::kFreeRunning);
    feed.set_exposure(exposure);
    period = std::max(period, feed.frame_period());
  }
  std::vector<std::vector<SeenFrame>> frames(feeds.size());
  std::vector<StampLine> lines;
  std::vector<core::Nanoseconds> jitter(feeds.size(), 0), under_way(feeds.size(), 0);
  for (CameraFeed& feed : feeds) lines.emplace_back(feed.frame_period());
  std::vector<double> full(feeds.size(), 0);
  bool clipped = false;
  const auto listen = [&](core::Nanoseconds until, const std::function<void(std::size_t, const CameraFrame&)>& hear) {
    while (pass.now() < until) {
      core::throw_if_interrupted();
      pass.listen(std::min(until, pass.now() + kInterruptDelay), [&](std::size_t c, const CameraFrame& frame) {
        if (!frame.damaged) hear(c, frame);
      });
    }
  };
  const core::Nanoseconds until_still = 3 * period + kSearchTo / 2;  // frames under way have come by then
  // All lights, still: how bright that is, and whether it is too bright to tell how long the lights were on.
  switch_lights(pass, true);
  listen(pass.now() + until_still, [](std::size_t, const CameraFrame&) {});
  listen(pass.now() + 2 * period, [&](std::size_t c, const CameraFrame& frame) {
    full[c] = mean_value(frame.image);
    clipped = clipped || clips(frame);
  });
  // n unit lights all round give three quarters of what one gives head-on at 3/n of their level (sequence.h).
  const float level = clipped ? std::min(1.0f, 3.0f / static_cast<float>(pass.rig().lights.light_count())) : 1.0f;
  std::vector<Switching> switchings{switch_lights(pass, false)};
  listen(pass.now() + until_still, [](std::size_t, const CameraFrame&) {});
  const auto note = [&](std::size_t c, const CameraFrame& frame) {
    if (const auto off_line = lines[c].note(frame)) jitter[c] = std::max(jitter[c], *off_line);
    under_way[c] = std::max(under_way[c], pass.now() - frame.timestamp);
    frames[c].push_back({frame.timestamp, mean_value(frame.image)});
  };
  for (int i = 0; i < kFlashes; ++i) {
    // Times that fit no multiple of the period, each another, so that only one delay explains them all.
    const double periods = 2.2 + 0.37 * i;
    switchings.push_back(switch_lights(pass, i % 2 == 0, level));
    listen(pass.now() + kFlashLeast + static_cast<core::Nanoseconds>(periods * static_cast<double>(period)), note);
  }
  switchings.push_back(switch_lights(pass, false));
  listen(pass.now() + until_still, note);

  Reference reference;
  for (std::size_t c = 0; c < feeds.size(); ++c) {
    if (frames[c].size() < 8) fail(feeds[c], "it sends no frames while it should run free");
    CameraReference camera;
    camera.brightness = brightness_of(frames[c]);
    if (!(camera.brightness.full > 1.5 * std::abs(camera.brightness.dark) + 1e-9)) {
      fail(feeds[c], "it does not see the lights (pictures with all of them on are no brighter than dark ones)");
    }
    camera.latency = best_latency(feeds[c], frames[c], switchings, camera.brightness, exposure);
    camera.brightness.full = full[c];
    camera.arrival = under_way[c] + spare(camera.latency.most + under_way[c]);
    camera.tolerance = kLeastTolerance / 4 + jitter[c];
    reference.cameras.push_back(camera);
  }
  return reference;
}

}  // namespace lightstage::capture
