// How deep a text of JSON or TOML goes, without parsing it: what walks through a parsed one goes one call deeper for each level, and a
// file of a few kilobytes can have so many that the stack ends.
#pragma once

#include <string_view>

namespace lightstage::core {

inline constexpr int kMostJsonLevels = 500;
inline constexpr int kMostKeyParts = 32;  // of a dotted key of TOML

// Whether more than `levels` brackets of a JSON text are open at a time.
bool json_nests_deeper(std::string_view json, int levels);

// The line (from 1) of the first key of a TOML text with more than `parts` parts (a.b.c has 3); 0 when there is none.
int line_of_longer_key(std::string_view toml, int parts);

}  // namespace lightstage::core
