// Strings as TOML text.
#pragma once

#include <string>
#include <string_view>

namespace lightstage::capture {

// In double quotes, with what TOML does not allow inside them escaped: reads back as these very characters. `text` must be
// UTF-8.
std::string toml_string(std::string_view text);

}  // namespace lightstage::capture
