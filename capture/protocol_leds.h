// The host's side of the project's own LED protocol (docs/led-protocol.md), over any link.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "capture/devices.h"
#include "capture/led_link.h"
#include "capture/led_protocol.h"
#include "core/clock.h"

namespace lightstage::capture {

struct ProtocolLedsOptions {
  std::string name = "LED controller";  // as error messages call it
  std::vector<int> output_of_light;     // the controller's output, from 0, for each light; no output twice
  // A thread tells the controller every 150 ms that the host lives. False only for a link whose time passes by sleeping.
  bool keep_alive = true;
};

// Every command is repeated with its sequence number when no answer comes in 100 ms, four times in all; the controller
// carries it out once. A DeviceError of any call but load() on patterns that the controller cannot hold leaves the controller
// given up: it is told nothing any more, so that it goes dark within 500 ms by itself, and the next call begins with IDENTIFY,
// which makes it dark at once. Sequences are loaded again by arm() where they were lost that way. Levels become 16 bits, linear.
//
// Trouble that the keep-alive thread finds, and faults that the controller reports by itself, are thrown by the next call
// of show, arm, wait_for_pattern or status: after an exposure, status() that returns without faults says that the lights
// have been as asked until now.
//
// One thread may call at a time.
class ProtocolLeds : public LedController, public PatternPlayer {
 public:
  // Asks the controller who it is; it is dark afterwards. Throws DeviceError when it does not answer, speaks another version
  // or has fewer outputs than the lights need; UsageError when two lights share an output.
  ProtocolLeds(std::unique_ptr<LedLink> link, ProtocolLedsOptions options, core::Clock& clock);
  // Turns everything off, if the controller listens.
  ~ProtocolLeds() override;
  ProtocolLeds(const ProtocolLeds&) = delete;
  ProtocolLeds& operator=(const ProtocolLeds&) = delete;

  // As the controller told it last.
  Identity identity() const;

  std::size_t light_count() const override;
  void show(std::span<const LightLevel> levels) override;
  void all_off() override;
  LedStatus status() override;
  // Null where the controller holds no sequences.
  PatternPlayer* player() override;

  void load(std::span<const std::vector<LightLevel>> patterns) override;
  // Delays are rounded up to 10 us; at most 0.65 s (DeviceError).
  void arm(std::size_t first, core::Nanoseconds delay) override;
  std::size_t position() override;
  // The time is that of receipt. When no event came until the deadline the controller is asked once where it stands, so that a
  // lost event costs time and nothing else; a controller that is mute then throws.
  std::optional<core::Nanoseconds> wait_for_pattern(std::size_t index, core::Nanoseconds deadline) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// What the set bits of `faults` mean, one line each.
std::vector<std::string> describe_faults(std::uint32_t faults);

}  // namespace lightstage::capture
