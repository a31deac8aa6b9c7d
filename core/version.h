#pragma once

namespace lightstage::core {

// The program's version, stored with everything it derives.
constexpr const char* kVersion = "0.1.0";

}  // namespace lightstage::core
