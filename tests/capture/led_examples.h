// The messages that docs/led-protocol.md shows byte by byte, and the same ones for tests that need one of each type.
#pragma once

#include <string>
#include <vector>

#include "capture/led_protocol.h"

namespace lightstage::test {

struct LedExample {
  std::string name;  // as the document's code block is labelled
  std::uint32_t sequence = 0;
  capture::LedMessage message;
};

inline std::vector<LedExample> led_examples() {
  using namespace capture;
  const std::vector<OutputPattern> patterns{{{0, 65535, 65535, 65535}}, {}, {{1, 256, 0, 0}, {63, 0, 0, 1}}};
  const std::vector<std::uint8_t> bytes = encode_patterns(patterns);
  const auto total = static_cast<std::uint32_t>(bytes.size());
  Identity identity;
  identity.firmware_major = 1;
  identity.firmware_minor = 2;
  identity.outputs = 64;
  identity.duty_per_mille = 250;
  identity.duty_window_ms = 20000;
  identity.on_time_limit_ms = 5000;
  identity.max_payload = 516;
  identity.max_patterns = 1024;
  identity.max_sequence_bytes = 65536;
  identity.temperature_limit_tenths = 750;
  identity.serial = "LS-0042";
  return {
      {"IDENTIFY", 1, Identify{}},
      {"IDENTITY", 1, identity},
      {"SHOW", 2, Show{{{3, 65535, 32768, 0}, {17, 0, 0, 1}}}},
      {"ACK", 2, Ack{LedMessageType::kShow, LedState::kShowing, 2, kNoPosition, 0}},
      {"LOAD", 3, Load{3, total, crc32c(bytes), 0, bytes}},
      {"ARM", 4, Arm{0, StepSource::kStrobe, StrobeEdge::kFalling}},
      {"STEPPED", 0, Stepped{1, 1, 1234567}},
      {"STEP", 5, StepOn{}},
      {"NAK", 5, Nak{LedMessageType::kStep, NakReason::kNotArmed, 0, 0}},
      {"STATUS", 6, AskStatus{}},
      {"STATUS_REPORT", 6, StatusReport{412, 1, 24050, 0, 3, 1, 1, 2000000, LedState::kArmed}},
      {"KEEP_ALIVE", 7, KeepAlive{}},
      {"OFF", 8, Off{}},
  };
}

}  // namespace lightstage::test
