// An LED controller that speaks the project's own protocol: what docs/led-protocol.md asks of firmware, as a state machine
// without any hardware. It serves the simulated back end and the emulated USB device of the hardware tests, and a maker of a
// controller can compare with it.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "capture/led_protocol.h"
#include "capture/light_limits.h"
#include "core/clock.h"

namespace lightstage::sim {

struct LedFirmwareOptions {
  // What IDENTIFY tells; its limits are the ones that are enforced.
  capture::Identity identity{.firmware_major = 1,
                             .outputs = 64,
                             .duty_per_mille = 500,
                             .duty_window_ms = 20'000,
                             .on_time_limit_ms = 10'000,
                             .max_payload = capture::kMaxLedPayload,
                             .max_patterns = 65'536,
                             .max_sequence_bytes = 16u << 20,
                             .temperature_limit_tenths = 750,
                             .serial = "SIM0001"};
  // Of flashing light (capture/light_limits.h); its heat limits play no part. None: the controller's own switch is off, which no host can change.
  std::optional<capture::LightLimits> flashing;
  // Longer than kHostSilenceLimit only for a host in virtual time, which sends no keep-alive while it sleeps.
  core::Nanoseconds host_silence_limit = capture::kHostSilenceLimit;
};

// Every call says what time it is, on a clock that starts at 0 with the controller's power and never goes back. What falls
// due in between happens at its own exact time, not when the call is made: limits do not depend on how often tick() comes.
class LedFirmware {
 public:
  // The outputs that are on from this time on, in rising order, without those at zero. Called at every change.
  using OnChange = std::function<void(core::Nanoseconds time, std::span<const capture::OutputLevel> lit)>;
  LedFirmware(LedFirmwareOptions options, OnChange on_change);

  // Bytes from the host, cut anywhere.
  void receive(std::span<const std::uint8_t> bytes, core::Nanoseconds now);
  // An edge at the strobe input.
  void strobe_edge(bool rising, core::Nanoseconds now);
  // Carries out what is due until `now`.
  void tick(core::Nanoseconds now);
  // When tick() has something to do next, if nothing else comes.
  std::optional<core::Nanoseconds> next_event() const;
  // The host's end is gone (cable, bus reset): dark at once.
  void disconnect(core::Nanoseconds now);
  // Of the hottest board.
  void set_temperature(double celsius, core::Nanoseconds now);
  void set_supply_volts(double volts);

  // Bytes for the host since the last call.
  std::vector<std::uint8_t> take_output();

  const capture::OutputPattern& lit() const { return lit_; }
  std::uint32_t faults() const { return faults_; }
  bool armed() const { return position_.has_value(); }

 private:
  struct Output {
    bool on = false, resting = false;
    core::Nanoseconds on_since = 0, heat_time = 0;
    std::int64_t heat = 0;  // nanoseconds times per mille, at heat_time
  };
  struct Due {
    core::Nanoseconds time = 0;
    std::uint32_t fault = 0;
    std::optional<std::size_t> output;  // that is exhausted
  };
  struct LastCommand {
    std::uint32_t sequence = 0;
    std::uint8_t type = 0;
    std::uint32_t payload_crc = 0;
    std::vector<std::uint8_t> reply;
  };
  struct Loading {
    capture::Load first;  // without its bytes
    std::vector<std::uint8_t> bytes;
  };

  void handle(const capture::LedFrame& frame, core::Nanoseconds now);
  capture::LedMessage carry_out(const capture::LedFrame& frame, core::Nanoseconds now);
  capture::LedMessage show(const capture::Show& command, core::Nanoseconds now);
  capture::LedMessage load(const capture::Load& command, core::Nanoseconds now);
  capture::LedMessage arm(const capture::Arm& command, core::Nanoseconds now);
  capture::LedMessage step_by_command(core::Nanoseconds now);
  capture::LedMessage identify(core::Nanoseconds now);
  capture::LedMessage off(core::Nanoseconds now);
  capture::StatusReport report(core::Nanoseconds now) const;
  capture::LedMessage ack(capture::LedMessageType command) const;
  capture::LedMessage nak(capture::LedMessageType command, capture::NakReason reason, std::uint32_t detail = 0) const;
  capture::LedState state() const;

  std::optional<std::uint32_t> resting_output(const capture::OutputPattern& pattern, core::Nanoseconds now);
  const capture::OutputPattern& pattern_at(std::size_t position) const;
  void light(const capture::OutputPattern& pattern, core::Nanoseconds time);
  void go_dark(core::Nanoseconds time);
  void fail(std::uint32_t fault, core::Nanoseconds time);
  void clear_faults();
  void warm(Output& output, core::Nanoseconds time) const;
  std::int64_t heat_limit() const;
  void find_exhaustion();
  void count_flashes(core::Nanoseconds time);
  std::optional<Due> next_due() const;
  void step_by_strobe(core::Nanoseconds time);
  void send(const capture::LedMessage& message, std::uint32_t sequence);

  LedFirmwareOptions options_;
  OnChange on_change_;
  capture::MessageReader reader_;
  core::Nanoseconds last_byte_ = 0, last_heard_ = 0;
  std::optional<LastCommand> last_;
  std::vector<std::uint8_t> out_;

  std::vector<Output> outputs_;
  capture::OutputPattern lit_;
  std::optional<Due> exhaustion_;               // of the first lit output that reaches a limit
  std::optional<capture::FlashMeter> flashes_;  // remembers what was seen whatever the host says
  std::optional<core::Nanoseconds> too_many_flashes_;
  std::optional<Loading> loading_;
  std::vector<capture::OutputPattern> patterns_;
  std::optional<std::size_t> position_;  // while armed
  capture::StepSource source_ = capture::StepSource::kCommand;
  capture::StrobeEdge edge_ = capture::StrobeEdge::kFalling;
  core::Nanoseconds delay_ = 0;
  std::deque<core::Nanoseconds> delayed_steps_;  // when they fall due
  std::uint32_t faults_ = 0, steps_ = 0, supply_millivolts_ = 0;
  std::int16_t temperature_tenths_ = capture::kNotMeasured;
};

}  // namespace lightstage::sim
