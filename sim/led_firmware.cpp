#include "sim/led_firmware.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lightstage::sim {

using capture::LedFrame;
using capture::LedMessage;
using capture::LedMessageType;
using capture::NakReason;
using capture::OutputLevel;
using capture::OutputPattern;
using core::Nanoseconds;

namespace {

// A controller that was too hot goes on when it is this much cooler than its limit.
constexpr int kHysteresisTenths = 100;

bool is_lit(const OutputLevel& level) {
  return level.r != 0 || level.g != 0 || level.b != 0;
}

bool in_range(const OutputPattern& pattern, std::size_t outputs) {
  return pattern.empty() || pattern.back().output < outputs;  // they rise
}

}  // namespace

LedFirmware::LedFirmware(LedFirmwareOptions options, OnChange on_change)
    : options_(std::move(options)), on_change_(std::move(on_change)), outputs_(options_.identity.outputs) {
  if (options_.flashing) flashes_.emplace(outputs_.size(), *options_.flashing);
}

// ---- time

std::optional<LedFirmware::Due> LedFirmware::next_due() const {
  std::optional<Due> due = exhaustion_;
  if (too_many_flashes_ && (!due || *too_many_flashes_ <= due->time)) {
    due = Due{*too_many_flashes_, capture::kFaultFlashing, {}};
  }
  if (!lit_.empty() || armed()) {
    const Nanoseconds silent = last_heard_ + options_.host_silence_limit;
    if (!due || silent <= due->time) due = Due{silent, capture::kFaultHostSilent, {}};
  }
  return due;
}

std::optional<Nanoseconds> LedFirmware::next_event() const {
  const std::optional<Due> due = next_due();
  if (delayed_steps_.empty()) return due ? std::optional(due->time) : std::nullopt;
  return due ? std::min(due->time, delayed_steps_.front()) : delayed_steps_.front();
}

void LedFirmware::tick(Nanoseconds now) {
  std::optional<Due> due = next_due();
  while (!delayed_steps_.empty() && delayed_steps_.front() <= now && (!due || delayed_steps_.front() < due->time)) {
    const Nanoseconds time = delayed_steps_.front();
    delayed_steps_.pop_front();
    step_by_strobe(time);
    due = next_due();
  }
  // Whatever else falls due first leaves the controller dark, so that nothing is due after it.
  if (!due || due->time > now) return;
  if (due->output) outputs_[*due->output].resting = due->fault == capture::kFaultDuty;
  fail(due->fault, due->time);
}

// ---- what is lit, and its limits

std::int64_t LedFirmware::heat_limit() const {
  return std::int64_t(options_.identity.duty_per_mille) * options_.identity.duty_window_ms * core::kMillisecond;
}

// Heat rises by 1 - duty while an output is on and falls by duty while it is off.
void LedFirmware::warm(Output& output, Nanoseconds time) const {
  const std::int64_t duty = options_.identity.duty_per_mille, elapsed = time - output.heat_time;
  output.heat_time = time;
  if (output.on) {
    output.heat += elapsed * (1000 - duty);
  } else {
    output.heat -= duty > 0 ? std::min(output.heat / duty + 1, elapsed) * duty : 0;
    output.heat = std::max<std::int64_t>(output.heat, 0);
  }
  if (output.resting && output.heat <= heat_limit() / 2) output.resting = false;
}

std::optional<std::uint32_t> LedFirmware::resting_output(const OutputPattern& pattern, Nanoseconds now) {
  for (const OutputLevel& level : pattern) {
    Output& output = outputs_[level.output];
    warm(output, now);
    if (is_lit(level) && output.resting) return level.output;
  }
  return std::nullopt;
}

void LedFirmware::light(const OutputPattern& pattern, Nanoseconds time) {
  OutputPattern lit;
  std::copy_if(pattern.begin(), pattern.end(), std::back_inserter(lit), is_lit);
  if (lit == lit_) return;
  std::vector<bool> on(outputs_.size());
  for (const OutputLevel& level : lit) on[level.output] = true;
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    if (outputs_[i].on == on[i]) continue;
    warm(outputs_[i], time);
    outputs_[i].on = on[i];
    if (on[i]) outputs_[i].on_since = time;
  }
  lit_ = std::move(lit);
  find_exhaustion();
  count_flashes(time);
  on_change_(time, lit_);
}

void LedFirmware::find_exhaustion() {
  exhaustion_.reset();
  const auto consider = [this](Nanoseconds time, std::uint32_t fault, std::size_t output) {
    if (!exhaustion_ || time < exhaustion_->time) exhaustion_ = Due{time, fault, output};
  };
  const capture::Identity& limits = options_.identity;
  for (const OutputLevel& level : lit_) {
    const Output& output = outputs_[level.output];
    if (limits.on_time_limit_ms > 0) {
      consider(output.on_since + limits.on_time_limit_ms * core::kMillisecond, capture::kFaultOnTime, level.output);
    }
    if (limits.duty_per_mille < 1000) {
      const std::int64_t rise = 1000 - limits.duty_per_mille;
      const std::int64_t room = std::max<std::int64_t>(heat_limit() - output.heat, 0);
      consider(output.heat_time + (room + rise - 1) / rise, capture::kFaultDuty, level.output);
    }
  }
}

void LedFirmware::count_flashes(Nanoseconds time) {
  if (!flashes_) return;
  constexpr double kFull = 65535.0;
  std::vector<capture::LitLight> shown;
  for (const OutputLevel& l : lit_) shown.push_back({l.output, {l.r / kFull, l.g / kFull, l.b / kFull}});
  flashes_->show(time, shown);
  too_many_flashes_ = flashes_->too_many();
}

void LedFirmware::go_dark(Nanoseconds time) {
  position_.reset();
  delayed_steps_.clear();
  light({}, time);
}

void LedFirmware::fail(std::uint32_t fault, Nanoseconds time) {
  faults_ |= fault;
  go_dark(time);
  send(report(time), 0);
}

void LedFirmware::clear_faults() {
  const bool still_hot = temperature_tenths_ > options_.identity.temperature_limit_tenths - kHysteresisTenths;
  faults_ &= still_hot ? std::uint32_t(capture::kFaultTemperature) : 0u;
}

void LedFirmware::set_temperature(double celsius, Nanoseconds now) {
  tick(now);
  temperature_tenths_ = static_cast<std::int16_t>(std::lround(celsius * 10));
  const bool hot = temperature_tenths_ >= options_.identity.temperature_limit_tenths;
  if (hot && !(faults_ & capture::kFaultTemperature)) fail(capture::kFaultTemperature, now);
}

void LedFirmware::set_supply_volts(double volts) {
  supply_millivolts_ = static_cast<std::uint32_t>(std::lround(volts * 1000));
}

void LedFirmware::disconnect(Nanoseconds now) {
  tick(now);
  go_dark(now);
  reader_ = {};
  last_.reset();
  loading_.reset();
  out_.clear();
}

// ---- messages

void LedFirmware::receive(std::span<const std::uint8_t> bytes, Nanoseconds now) {
  tick(now);
  const auto handle_all = [&] {
    while (const std::optional<LedFrame> frame = reader_.next()) handle(*frame, now);
  };
  if (now - last_byte_ >= capture::kPartialMessageLimit) {
    while (reader_.partial()) {
      reader_.give_up_partial();
      handle_all();
    }
  }
  last_byte_ = now;
  reader_.feed(bytes);
  handle_all();
}

void LedFirmware::handle(const LedFrame& frame, Nanoseconds now) {
  last_heard_ = now;
  const auto type = static_cast<LedMessageType>(frame.type);
  const std::uint32_t crc = capture::crc32c(frame.payload);
  if (type == LedMessageType::kIdentify) last_.reset();  // a host that begins counts anew
  if (last_ && type != LedMessageType::kOff) {
    const auto ahead = static_cast<std::int32_t>(frame.sequence - last_->sequence);
    if (ahead == 0 && last_->type == frame.type && last_->payload_crc == crc) {
      out_.insert(out_.end(), last_->reply.begin(), last_->reply.end());
      return;
    }
    if (ahead <= 0) return send(nak(type, NakReason::kBadSequence), frame.sequence);
  }
  const LedMessage answer = carry_out(frame, now);
  last_ = LastCommand{frame.sequence, frame.type, crc, capture::encode(answer, frame.sequence)};
  out_.insert(out_.end(), last_->reply.begin(), last_->reply.end());
}

LedMessage LedFirmware::carry_out(const LedFrame& frame, Nanoseconds now) {
  const auto type = static_cast<LedMessageType>(frame.type);
  if (type == LedMessageType::kOff) return off(now);  // whatever its payload is
  if (type < LedMessageType::kIdentify || type > LedMessageType::kKeepAlive) return nak(type, NakReason::kUnknownType);
  if (frame.payload.size() > options_.identity.max_payload) {
    return nak(type, NakReason::kTooLarge, options_.identity.max_payload);
  }
  const std::optional<LedMessage> command = capture::decode(frame);
  if (!command) return nak(type, NakReason::kBadPayload);
  switch (type) {
    case LedMessageType::kIdentify:
      return identify(now);
    case LedMessageType::kShow:
      return show(std::get<capture::Show>(*command), now);
    case LedMessageType::kLoad:
      return load(std::get<capture::Load>(*command), now);
    case LedMessageType::kArm:
      return arm(std::get<capture::Arm>(*command), now);
    case LedMessageType::kStep:
      return step_by_command(now);
    case LedMessageType::kStatus:
      return report(now);
    default:
      return ack(type);
  }
}

LedMessage LedFirmware::identify(Nanoseconds now) {
  go_dark(now);
  clear_faults();
  loading_.reset();
  patterns_.clear();
  return options_.identity;
}

LedMessage LedFirmware::off(Nanoseconds now) {
  go_dark(now);
  clear_faults();
  return ack(LedMessageType::kOff);
}

LedMessage LedFirmware::show(const capture::Show& command, Nanoseconds now) {
  constexpr LedMessageType kType = LedMessageType::kShow;
  if (faults_ != 0) return nak(kType, NakReason::kFault);
  if (!in_range(command.pattern, outputs_.size())) {
    return nak(kType, NakReason::kBadOutput, command.pattern.back().output);
  }
  if (const auto output = resting_output(command.pattern, now)) return nak(kType, NakReason::kResting, *output);
  position_.reset();
  delayed_steps_.clear();
  light(command.pattern, now);
  return ack(kType);
}

LedMessage LedFirmware::load(const capture::Load& command, Nanoseconds now) {
  constexpr LedMessageType kType = LedMessageType::kLoad;
  if (command.offset == 0) {
    if (command.patterns > options_.identity.max_patterns) {
      return nak(kType, NakReason::kTooLarge, options_.identity.max_patterns);
    }
    if (command.total_bytes > options_.identity.max_sequence_bytes) {
      return nak(kType, NakReason::kTooLarge, options_.identity.max_sequence_bytes);
    }
    if (armed()) go_dark(now);
    patterns_.clear();
    loading_ = Loading{{command.patterns, command.total_bytes, command.crc, 0, {}}, {}};
  }
  const std::size_t expected = loading_ ? loading_->bytes.size() : 0;
  const bool continues = loading_ && command.offset == expected && command.patterns == loading_->first.patterns &&
                         command.total_bytes == loading_->first.total_bytes && command.crc == loading_->first.crc;
  if (!continues) return nak(kType, NakReason::kBadOffset, static_cast<std::uint32_t>(expected));
  loading_->bytes.insert(loading_->bytes.end(), command.bytes.begin(), command.bytes.end());
  if (loading_->bytes.size() < loading_->first.total_bytes) return ack(kType);

  const Loading whole = std::move(*loading_);
  loading_.reset();
  if (capture::crc32c(whole.bytes) != whole.first.crc) return nak(kType, NakReason::kBadChecksum);
  std::optional<std::vector<OutputPattern>> patterns = capture::decode_patterns(whole.bytes, whole.first.patterns);
  if (!patterns || patterns->empty()) return nak(kType, NakReason::kBadPayload);
  for (const OutputPattern& pattern : *patterns) {
    if (!in_range(pattern, outputs_.size())) return nak(kType, NakReason::kBadOutput, pattern.back().output);
  }
  patterns_ = std::move(*patterns);
  return ack(kType);
}

LedMessage LedFirmware::arm(const capture::Arm& command, Nanoseconds now) {
  constexpr LedMessageType kType = LedMessageType::kArm;
  if (faults_ != 0) return nak(kType, NakReason::kFault);
  if (patterns_.empty()) return nak(kType, NakReason::kNotLoaded);
  if (command.first >= patterns_.size()) {
    return nak(kType, NakReason::kBadIndex, static_cast<std::uint32_t>(patterns_.size()));
  }
  if (const auto output = resting_output(patterns_[command.first], now)) {
    return nak(kType, NakReason::kResting, *output);
  }
  source_ = command.source;
  edge_ = command.edge;
  delay_ = command.delay * Nanoseconds{10'000};
  delayed_steps_.clear();
  position_ = command.first;
  light(patterns_[command.first], now);
  return ack(kType);
}

const OutputPattern& LedFirmware::pattern_at(std::size_t position) const {
  static const OutputPattern kDark;
  return position < patterns_.size() ? patterns_[position] : kDark;
}

LedMessage LedFirmware::step_by_command(Nanoseconds now) {
  constexpr LedMessageType kType = LedMessageType::kStep;
  if (!armed() || source_ != capture::StepSource::kCommand) return nak(kType, NakReason::kNotArmed);
  if (*position_ >= patterns_.size()) return nak(kType, NakReason::kPastEnd);
  const OutputPattern& next = pattern_at(*position_ + 1);
  if (const auto output = resting_output(next, now)) return nak(kType, NakReason::kResting, *output);
  ++*position_;
  ++steps_;
  light(next, now);
  return ack(kType);
}

void LedFirmware::strobe_edge(bool rising, Nanoseconds now) {
  tick(now);
  const bool wanted = rising == (edge_ == capture::StrobeEdge::kRising);
  if (!armed() || source_ != capture::StepSource::kStrobe || !wanted) return;
  if (*position_ + delayed_steps_.size() >= patterns_.size()) return;
  if (delay_ == 0) return step_by_strobe(now);
  delayed_steps_.push_back(now + delay_);
}

void LedFirmware::step_by_strobe(Nanoseconds time) {
  const OutputPattern& next = pattern_at(*position_ + 1);
  if (resting_output(next, time)) return fail(capture::kFaultDuty, time);
  ++*position_;
  ++steps_;
  light(next, time);
  send(capture::Stepped{static_cast<std::uint32_t>(*position_), steps_, static_cast<std::uint64_t>(time / 1000)}, 0);
}

// ---- answers

capture::LedState LedFirmware::state() const {
  if (armed()) return capture::LedState::kArmed;
  return lit_.empty() ? capture::LedState::kDark : capture::LedState::kShowing;
}

LedMessage LedFirmware::ack(LedMessageType command) const {
  return capture::Ack{command, state(), static_cast<std::uint16_t>(lit_.size()),
                      position_ ? static_cast<std::uint32_t>(*position_) : capture::kNoPosition, faults_};
}

LedMessage LedFirmware::nak(LedMessageType command, NakReason reason, std::uint32_t detail) const {
  return capture::Nak{command, reason, detail, faults_};
}

capture::StatusReport LedFirmware::report(Nanoseconds now) const {
  capture::StatusReport r;
  r.temperature_tenths = temperature_tenths_;
  r.lit = static_cast<std::uint16_t>(lit_.size());
  r.supply_millivolts = supply_millivolts_;
  r.faults = faults_;
  r.patterns = static_cast<std::uint32_t>(patterns_.size());
  r.position = position_ ? static_cast<std::uint32_t>(*position_) : capture::kNoPosition;
  r.steps = steps_;
  r.time_us = static_cast<std::uint64_t>(now / 1000);
  r.state = state();
  return r;
}

void LedFirmware::send(const LedMessage& message, std::uint32_t sequence) {
  const std::vector<std::uint8_t> bytes = capture::encode(message, sequence);
  out_.insert(out_.end(), bytes.begin(), bytes.end());
}

std::vector<std::uint8_t> LedFirmware::take_output() {
  return std::exchange(out_, {});
}

}  // namespace lightstage::sim
