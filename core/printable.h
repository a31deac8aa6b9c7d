// Text that somebody else wrote, as it may be shown: a name in a stranger's list or store must not move the cursor, change
// the title of the terminal or turn the reading order of what stands beside it.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace lightstage::core {

// Everything that is not printable becomes visible: a newline, tab and carriage return "\n", "\t" and "\r", other control characters
// (C0, DEL, C1), bytes that are not UTF-8 as "\x1b", and marks that turn the reading order as "\u202e". The result is one line of
// valid UTF-8. What is printable already comes back as it is.
std::string printable(std::string_view text);

// The same, but lines stay lines and tabs stay tabs.
std::string printable_lines(std::string_view text);

// A name in quotes: printable, and of a very long one the beginning and how many bytes it has.
std::string quoted(std::string_view name);

}  // namespace lightstage::core
