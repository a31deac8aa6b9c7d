#include "capture/protocol_leds.h"

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "core/error.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {

constexpr core::Nanoseconds kReplyTimeout = 100 * core::kMillisecond;
constexpr core::Nanoseconds kDelayUnit = 10'000;  // of ARM
constexpr int kTries = 4;
constexpr core::Nanoseconds kKeepAlivePeriod = 150 * core::kMillisecond;
constexpr std::size_t kLoadChunk = 4096;
constexpr std::size_t kLoadHead = 16;
constexpr std::size_t kLeastPayload = 64;

std::uint16_t level16(float level) {
  return static_cast<std::uint16_t>(std::lround(double(level) * 65535));
}

bool answers(const LedMessage& reply, const LedMessage& command) {
  const LedMessageType type = type_of(command);
  if (const auto* nak = std::get_if<Nak>(&reply)) return nak->command == type;
  if (type == LedMessageType::kIdentify) return std::holds_alternative<Identity>(reply);
  if (type == LedMessageType::kStatus) return std::holds_alternative<StatusReport>(reply);
  const auto* ack = std::get_if<Ack>(&reply);
  return ack != nullptr && ack->command == type;
}

std::string explain(const Nak& nak) {
  const std::string detail = std::to_string(nak.detail);
  switch (nak.reason) {
    case NakReason::kUnknownType:
      return "it does not know this message; its firmware is too old";
    case NakReason::kBadPayload:
      return "it does not understand the message's content; its firmware may be too old";
    case NakReason::kBadSequence:
      return "messages are out of order; another program may be using it";
    case NakReason::kBadOutput:
      return "it has no output " + detail;
    case NakReason::kTooLarge:
      return "it holds no more than " + detail;
    case NakReason::kBadOffset:
      return "a part of the sequence is missing before byte " + detail;
    case NakReason::kBadChecksum:
      return "the sequence arrived damaged";
    case NakReason::kNotLoaded:
      return "no sequence is loaded";
    case NakReason::kBadIndex:
      return "its sequence has " + detail + " patterns";
    case NakReason::kNotArmed:
      return "it is not armed";
    case NakReason::kPastEnd:
      return "its sequence is over";
    case NakReason::kFault:
      return "it has switched its lights off by itself (" + core::joined(describe_faults(nak.faults), "; ") + ")";
    case NakReason::kResting:
      return "output " + detail + " was on for too much of the time and must rest; shoot more slowly or more briefly";
  }
  return "for reason " + std::to_string(static_cast<int>(nak.reason)) + ", which this program does not know";
}

}  // namespace

std::vector<std::string> describe_faults(std::uint32_t faults) {
  std::vector<std::string> lines;
  for (std::uint32_t bit = 0; bit < 32; ++bit) {
    const std::uint32_t fault = 1u << bit;
    if (!(faults & fault)) continue;
    switch (fault) {
      case kFaultHostSilent:
        lines.emplace_back("the host was silent for 500 ms");
        break;
      case kFaultOnTime:
        lines.emplace_back("an output was on for longer than its limit");
        break;
      case kFaultDuty:
        lines.emplace_back("an output was on for too much of the time");
        break;
      case kFaultTemperature:
        lines.emplace_back("too hot: let it cool down");
        break;
      case kFaultFlashing:
        lines.emplace_back("the lights flashed too often, which can set off seizures");
        break;
      default:
        lines.push_back("fault " + std::to_string(bit) + ": see the controller's manual");
    }
  }
  return lines;
}

struct ProtocolLeds::Impl {
  Impl(std::unique_ptr<LedLink> the_link, ProtocolLedsOptions the_options, core::Clock& the_clock)
      : link(std::move(the_link)),
        options(std::move(the_options)),
        clock(the_clock),
        sequence(static_cast<std::uint32_t>(the_clock.now() / 1000)) {}

  // ---- one message there and one back

  // Something is being thrown: nothing is asked of the controller before it has been identified again.
  void give_up() {
    ready = armed = false;
    reported_faults = 0;
    trouble.clear();
  }

  [[noreturn]] void fail(const std::string& problem) {
    give_up();
    throw core::DeviceError(options.name + ": " + problem);
  }

  // The next good message until the deadline. What follows a message whose end never came is found at the deadline.
  std::optional<LedFrame> next_frame(core::Nanoseconds deadline) {
    while (true) {
      if (std::optional<LedFrame> frame = reader.next()) return frame;
      const std::vector<std::uint8_t> bytes = link->read(deadline);
      reader.feed(bytes);
      if (!bytes.empty()) continue;
      while (reader.partial()) {
        reader.give_up_partial();
        if (std::optional<LedFrame> frame = reader.next()) return frame;
      }
      if (clock.now() >= deadline) return std::nullopt;
    }
  }

  // What the controller says without being asked.
  void take_event(const LedFrame& frame) {
    const std::optional<LedMessage> message = frame.sequence == 0 ? decode(frame) : std::nullopt;
    if (!message) return;
    if (const auto* stepped = std::get_if<Stepped>(&*message)) reach(stepped->position);
    if (const auto* report = std::get_if<StatusReport>(&*message)) reported_faults |= report->faults;
  }

  void reach(std::uint32_t position) {
    if (position != kNoPosition) reached.emplace(position, clock.now());
  }

  // Throws DeviceError when no answer comes. Whatever goes wrong, the controller is given up.
  LedMessage exchange(const LedMessage& command, int tries = kTries) {
    if (++sequence == 0) ++sequence;  // 0 is for events
    const std::vector<std::uint8_t> bytes = encode(command, sequence);
    try {
      for (int i = 0; i < tries; ++i) {
        const core::Nanoseconds sent = clock.now(), deadline = sent + kReplyTimeout;
        link->write(bytes, deadline);
        while (const std::optional<LedFrame> frame = next_frame(deadline)) {
          std::optional<LedMessage> reply = decode(*frame);
          if (reply && frame->sequence == sequence && answers(*reply, command)) {
            last_contact = sent;
            return std::move(*reply);
          }
          take_event(*frame);  // or a late answer to what was given up, even by a host before this one
        }
      }
    } catch (...) {
      give_up();
      throw;
    }
    fail("no answer to " + std::string(to_string(type_of(command))) + " (asked " + std::to_string(tries) +
         " times); check its power and cable");
  }

  template <class Reply>
  Reply expect(const LedMessage& command) {
    const LedMessage reply = exchange(command);
    if (const auto* wanted = std::get_if<Reply>(&reply)) return *wanted;
    fail("refused " + std::string(to_string(type_of(command))) + ": " + explain(std::get<Nak>(reply)));
  }

  Ack obeyed(const LedMessage& command) { return expect<Ack>(command); }

  // ---- state

  void identify() {
    const auto reply = expect<Identity>(Identify{});
    if (reply.protocol != kLedProtocolVersion) {
      fail("it speaks version " + std::to_string(reply.protocol) + " of the protocol, this program " +
           std::to_string(kLedProtocolVersion));
    }
    if (reply.max_payload < std::max(kLeastPayload, 4 + 8 * std::size_t(reply.outputs))) {
      fail("it takes messages of " + std::to_string(reply.max_payload) +
           " bytes only: too few to light all its outputs");
    }
    for (const int output : options.output_of_light) {
      if (output >= reply.outputs) {
        fail("it has " + std::to_string(reply.outputs) + " outputs, the stage file names output " +
             std::to_string(output));
      }
    }
    identity = reply;
    loaded = armed = false;
    reported_faults = 0;
    reached.clear();
    ready = true;
  }

  // Trouble of which no caller has heard yet.
  void throw_trouble() {
    if (reported_faults != 0) {
      fail("it has switched its lights off by itself (" + core::joined(describe_faults(reported_faults), "; ") + ")");
    }
    if (!trouble.empty()) throw core::DeviceError(std::exchange(trouble, {}));
  }

  void make_ready() {
    throw_trouble();
    if (!ready) identify();
  }

  OutputPattern outputs(std::span<const LightLevel> levels) {
    OutputPattern pattern;
    for (const LightLevel& l : levels) {
      const auto good = [](float v) { return v >= 0 && v <= 1; };
      const bool known = l.light_index >= 0 && std::size_t(l.light_index) < options.output_of_light.size();
      if (!known || !good(l.r) || !good(l.g) || !good(l.b)) {
        fail("cannot show light " + std::to_string(l.light_index) + " at " + std::to_string(l.r) + ", " +
             std::to_string(l.g) + ", " + std::to_string(l.b));
      }
      const int output = options.output_of_light[std::size_t(l.light_index)];
      pattern.push_back({static_cast<std::uint16_t>(output), level16(l.r), level16(l.g), level16(l.b)});
    }
    const auto by_output = [](const OutputLevel& a, const OutputLevel& b) { return a.output < b.output; };
    std::sort(pattern.begin(), pattern.end(), by_output);
    const auto same_output = [](const OutputLevel& a, const OutputLevel& b) { return a.output == b.output; };
    if (std::adjacent_find(pattern.begin(), pattern.end(), same_output) != pattern.end()) {
      fail("cannot show one light twice in a pattern");
    }
    return pattern;
  }

  void upload() {
    const std::size_t chunk = std::min(kLoadChunk, std::size_t(identity.max_payload)) - kLoadHead;
    Load part{pattern_count, static_cast<std::uint32_t>(sequence_bytes.size()), crc32c(sequence_bytes), 0, {}};
    for (std::size_t at = 0; at < sequence_bytes.size(); at += chunk) {
      const auto bytes = std::span(sequence_bytes).subspan(at, std::min(chunk, sequence_bytes.size() - at));
      part.offset = static_cast<std::uint32_t>(at);
      part.bytes.assign(bytes.begin(), bytes.end());
      obeyed(part);
    }
    loaded = true;
    armed = false;
  }

  void keep_alive() {
    const Ack ack = obeyed(KeepAlive{});
    if (armed) reach(ack.position);
    reported_faults |= ack.faults;
  }

  void keep_alive_until_stopped() {
    std::unique_lock lock(mutex);
    while (!stop) {
      const core::Nanoseconds now = clock.now();
      const core::Nanoseconds due = ready ? last_contact + kKeepAlivePeriod : now + kKeepAlivePeriod;
      if (due > now) {
        wake.wait_for(lock, std::chrono::nanoseconds(due - now));
        continue;
      }
      try {
        keep_alive();
      } catch (const std::exception& error) {  // nothing may leave the thread
        trouble = error.what();
      }
    }
  }

  const std::unique_ptr<LedLink> link;
  const ProtocolLedsOptions options;
  core::Clock& clock;

  std::mutex mutex;  // over everything below
  MessageReader reader;
  std::uint32_t sequence;  // begins where no host before this one left off
  core::Nanoseconds last_contact = 0;
  bool ready = false;  // identified, and nothing has gone wrong since
  Identity identity;
  std::string trouble;
  std::uint32_t reported_faults = 0;

  std::vector<std::uint8_t> sequence_bytes;
  std::uint32_t pattern_count = 0;
  bool loaded = false, armed = false;
  std::map<std::uint32_t, core::Nanoseconds> reached;  // by position, since the player was armed

  bool stop = false;
  std::condition_variable wake;
  std::thread thread;
};

ProtocolLeds::ProtocolLeds(std::unique_ptr<LedLink> link, ProtocolLedsOptions options, core::Clock& clock)
    : impl_(std::make_unique<Impl>(std::move(link), std::move(options), clock)) {
  std::vector<int> sorted = impl_->options.output_of_light;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end() || (!sorted.empty() && sorted.front() < 0)) {
    throw core::UsageError(impl_->options.name + ": every light needs an output of its own, from 0");
  }
  impl_->identify();
  if (impl_->options.keep_alive)
    impl_->thread = std::thread([impl = impl_.get()] { impl->keep_alive_until_stopped(); });
}

ProtocolLeds::~ProtocolLeds() {
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->stop = true;
  }
  impl_->wake.notify_all();
  if (impl_->thread.joinable()) impl_->thread.join();
  if (!impl_->ready) return;  // it goes dark by itself
  try {
    impl_->exchange(Off{}, 1);
  } catch (...) {  // it goes dark by itself
  }
}

Identity ProtocolLeds::identity() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->identity;
}

std::size_t ProtocolLeds::light_count() const {
  return impl_->options.output_of_light.size();
}

void ProtocolLeds::show(std::span<const LightLevel> levels) {
  const std::lock_guard lock(impl_->mutex);
  impl_->make_ready();
  impl_->armed = false;
  impl_->obeyed(Show{impl_->outputs(levels)});
}

void ProtocolLeds::all_off() {
  const std::lock_guard lock(impl_->mutex);
  impl_->trouble.clear();
  impl_->reported_faults = 0;
  impl_->armed = false;
  if (!impl_->ready) impl_->identify();
  if (impl_->obeyed(Off{}).lit != 0) impl_->fail("it says that lights are on after it was told to turn them off");
}

LedStatus ProtocolLeds::status() {
  const std::lock_guard lock(impl_->mutex);
  impl_->make_ready();
  const auto report = impl_->expect<StatusReport>(AskStatus{});
  LedStatus status;
  if (report.temperature_tenths != kNotMeasured) status.temperature_celsius = report.temperature_tenths / 10.0;
  if (report.supply_millivolts != 0) status.supply_volts = report.supply_millivolts / 1000.0;
  status.faults = describe_faults(report.faults);
  return status;
}

PatternPlayer* ProtocolLeds::player() {
  const std::lock_guard lock(impl_->mutex);
  return impl_->identity.max_patterns > 0 ? this : nullptr;
}

void ProtocolLeds::load(std::span<const std::vector<LightLevel>> patterns) {
  const std::lock_guard lock(impl_->mutex);
  impl_->make_ready();
  std::vector<OutputPattern> encoded;
  for (const std::vector<LightLevel>& levels : patterns) encoded.push_back(impl_->outputs(levels));
  std::vector<std::uint8_t> bytes = encode_patterns(encoded);
  const Identity& limits = impl_->identity;
  if (patterns.empty() || patterns.size() > limits.max_patterns || bytes.size() > limits.max_sequence_bytes) {
    throw core::DeviceError(impl_->options.name + ": it holds 1 to " + std::to_string(limits.max_patterns) +
                            " patterns in at most " + std::to_string(limits.max_sequence_bytes) + " bytes, these are " +
                            std::to_string(patterns.size()) + " in " + std::to_string(bytes.size()) +
                            "; capture in lockstep instead");
  }
  impl_->sequence_bytes = std::move(bytes);
  impl_->pattern_count = static_cast<std::uint32_t>(patterns.size());
  impl_->loaded = impl_->armed = false;
  impl_->upload();
}

void ProtocolLeds::arm(std::size_t first, core::Nanoseconds delay) {
  const std::lock_guard lock(impl_->mutex);
  const core::Nanoseconds units = (delay + kDelayUnit - 1) / kDelayUnit;
  if (delay < 0 || units > 0xFFFF) {
    throw core::DeviceError(impl_->options.name + ": it can wait at most 0.65 s after a strobe");
  }
  impl_->make_ready();
  if (!impl_->loaded && impl_->pattern_count > 0) impl_->upload();
  impl_->armed = false;
  const Ack ack = impl_->obeyed(Arm{static_cast<std::uint32_t>(first), StepSource::kStrobe, StrobeEdge::kFalling,
                                    static_cast<std::uint16_t>(units)});
  // Events that came before the answer belong to what was armed before.
  impl_->reached.clear();
  impl_->armed = true;
  impl_->reach(ack.position);
}

std::size_t ProtocolLeds::position() {
  const std::lock_guard lock(impl_->mutex);
  impl_->throw_trouble();
  if (!impl_->armed) impl_->fail("it is not armed");
  const Ack ack = impl_->obeyed(KeepAlive{});
  impl_->reported_faults |= ack.faults;
  impl_->throw_trouble();
  if (ack.position == kNoPosition) impl_->fail("it has forgotten the sequence that it was stepping through");
  impl_->reach(ack.position);
  return ack.position;
}

std::optional<core::Nanoseconds> ProtocolLeds::wait_for_pattern(std::size_t index, core::Nanoseconds deadline) {
  const std::lock_guard lock(impl_->mutex);
  impl_->throw_trouble();
  if (!impl_->armed) impl_->fail("it is not armed");
  const auto position = static_cast<std::uint32_t>(index);
  // Beyond the pattern that is waited for, its own event was lost, and it is not lit any more.
  const auto decided = [&] { return impl_->reached.lower_bound(position) != impl_->reached.end(); };
  while (!decided() && impl_->clock.now() < deadline) {
    const core::Nanoseconds keep_alive_due = impl_->last_contact + kKeepAlivePeriod;
    if (impl_->options.keep_alive && impl_->clock.now() >= keep_alive_due) impl_->keep_alive();
    try {
      const core::Nanoseconds until = impl_->options.keep_alive ? std::min(deadline, keep_alive_due) : deadline;
      if (const std::optional<LedFrame> frame = impl_->next_frame(until)) impl_->take_event(*frame);
    } catch (...) {
      impl_->give_up();
      throw;
    }
    impl_->throw_trouble();
  }
  if (!decided()) impl_->keep_alive();
  impl_->throw_trouble();
  const auto found = impl_->reached.find(position);
  if (found == impl_->reached.end()) return std::nullopt;
  return found->second;
}

}  // namespace lightstage::capture
