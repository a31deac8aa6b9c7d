// Numbers as TOML text.
#pragma once

#include <string>

namespace lightstage::capture {

// The shortest text that reads back as exactly this float (bit for bit, signed zero included): always with a
// point or an exponent, so that TOML does not take it for an integer. `value` must be finite.
std::string toml_number(double value);

}  // namespace lightstage::capture
