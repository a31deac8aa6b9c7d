// Small text: trimming, splitting, and numbers that do not depend on the locale.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace lightstage::core {

// Without spaces, tabs, carriage returns and newlines at both ends.
std::string_view trim(std::string_view text);

// The pieces between separators; n separators give n + 1 pieces, which may be empty.
std::vector<std::string_view> split(std::string_view text, char separator);

// The whole text as one decimal number, a leading '+' allowed; nothing when anything else is there or the
// value does not fit. "inf" and "nan" parse to what they say: callers that need finite values must look.
std::optional<double> parse_number(std::string_view text);
std::optional<std::int64_t> parse_integer(std::string_view text);

// The value with the given number of significant digits, in the shortest of plain and scientific notation.
std::string number_text(double value, int significant_digits = 9);

}  // namespace lightstage::core
