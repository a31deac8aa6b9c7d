#include "capture/usb/dmx_leds.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/error.h"

namespace lightstage::capture {

namespace {

constexpr core::Nanoseconds kReplyTimeout = 100 * core::kMillisecond, kQuiet = 20 * core::kMillisecond;
constexpr int kTries = 3;

std::uint8_t level8(double level) {
  return static_cast<std::uint8_t>(std::lround(level * 255));
}

std::size_t highest_channel(const DmxLedsOptions& options) {
  std::set<int> seen;
  for (const std::vector<int>& channels : options.channels_of_light) {
    const auto good = [&](int channel) {
      return channel >= 1 && channel <= int(kDmxChannels) && seen.insert(channel).second;
    };
    if ((channels.size() != 1 && channels.size() != 3) || !std::all_of(channels.begin(), channels.end(), good)) {
      throw core::UsageError(options.name + ": every light needs one or three channels of its own, from 1 to " +
                             std::to_string(kDmxChannels));
    }
  }
  return seen.empty() ? 0 : std::size_t(*seen.rbegin());
}

}  // namespace

DmxLeds::DmxLeds(std::unique_ptr<LedLink> link, DmxLedsOptions options, core::Clock& clock,
                 std::unique_ptr<LightsOffOnDeath> guard)
    : guard_(std::move(guard)),
      link_(std::move(link)),
      options_(std::move(options)),
      clock_(clock),
      used_channels_(highest_channel(options_)) {
  send({});  // how fast it is
  all_off();
}

DmxLeds::~DmxLeds() {
  try {
    all_off();
  } catch (const core::Error&) {  // the guard does it
  }
}

void DmxLeds::show(std::span<const LightLevel> levels) {
  std::vector<std::uint8_t> channels(used_channels_);
  for (const LightLevel& l : levels) {
    const auto good = [](float v) { return v >= 0 && v <= 1; };
    if (l.light_index < 0 || std::size_t(l.light_index) >= light_count() || !good(l.r) || !good(l.g) || !good(l.b)) {
      throw core::DeviceError(options_.name + ": cannot show light " + std::to_string(l.light_index) + " at " +
                              std::to_string(l.r) + ", " + std::to_string(l.g) + ", " + std::to_string(l.b));
    }
    const std::vector<int>& of_light = options_.channels_of_light[std::size_t(l.light_index)];
    const auto set = [&](std::size_t i, double level) { channels[std::size_t(of_light[i] - 1)] = level8(level); };
    if (of_light.size() == 1) {
      set(0, (double(l.r) + double(l.g) + double(l.b)) / 3);
    } else {
      set(0, l.r);
      set(1, l.g);
      set(2, l.b);
    }
  }
  if (guard_) guard_->lights_on();
  show_channels(channels);
}

void DmxLeds::all_off() {
  show_channels(std::vector<std::uint8_t>(kDmxChannels));
  if (guard_) guard_->lights_off();
}

LedStatus DmxLeds::status() {
  send({});
  return {};
}

void DmxLeds::show_channels(std::span<const std::uint8_t> channels) {
  send(encode(dmx_frame(channels)));
  clock_.sleep_until(clock_.now() + dmx_settling(channels.size(), parameters_));
}

void DmxLeds::send(std::span<const std::uint8_t> bytes) {
  const std::vector<std::uint8_t> request = encode(DmxMessage{std::uint8_t(DmxLabel::kParameters), {0, 0}});
  std::vector<std::uint8_t> both(bytes.begin(), bytes.end());
  both.insert(both.end(), request.begin(), request.end());
  for (int i = 0; i < kTries; ++i) {
    if (late_answers_) skip_late_answers();
    late_answers_ = true;  // until all is well
    const core::Nanoseconds deadline = clock_.now() + kReplyTimeout;
    link_->write(both, deadline);
    while (const std::optional<DmxMessage> message = next_message(deadline)) {
      const std::optional<DmxParameters> parameters = decode_parameters(*message);
      if (!parameters) continue;  // DMX that it heard before it was told to send
      parameters_ = *parameters;
      late_answers_ = false;
      return;
    }
  }
  throw core::DeviceError(options_.name + ": no answer (asked " + std::to_string(kTries) +
                          " times); check that it is an Enttec DMX USB Pro or compatible with it");
}

// An answer that came too late must not be taken for one to what is sent next.
void DmxLeds::skip_late_answers() {
  // A widget that hears DMX reports it all the time.
  const core::Nanoseconds end = clock_.now() + kReplyTimeout;
  while (clock_.now() < end && next_message(clock_.now() + kQuiet)) {
  }
}

std::optional<DmxMessage> DmxLeds::next_message(core::Nanoseconds deadline) {
  while (true) {
    if (std::optional<DmxMessage> message = reader_.next()) return message;
    const std::vector<std::uint8_t> bytes = link_->read(deadline);
    reader_.feed(bytes);
    if (!bytes.empty()) continue;
    while (reader_.partial()) {
      reader_.give_up_partial();
      if (std::optional<DmxMessage> message = reader_.next()) return message;
    }
    if (clock_.now() >= deadline) return std::nullopt;
  }
}

}  // namespace lightstage::capture
