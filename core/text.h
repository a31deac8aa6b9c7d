// Small text: trimming, lists, numbers that do not depend on the locale, and the name a user probably meant.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lightstage::core {

// Without spaces, tabs, carriage returns and newlines at both ends.
std::string_view trim(std::string_view text);

// The pieces between separators; n separators give n + 1 pieces, which may be empty.
std::vector<std::string_view> split(std::string_view text, char separator);

// The pieces one after another with the separator between them; empty for none.
std::string joined(std::span<const std::string> pieces, std::string_view separator);

// The whole text as one decimal number, a leading '+' allowed; nothing when anything else is there or the
// value does not fit. "inf" and "nan" parse to what they say: callers that need finite values must look.
std::optional<double> parse_number(std::string_view text);
std::optional<std::int64_t> parse_integer(std::string_view text);

// The value with the given number of significant digits, in the shortest of plain and scientific notation.
std::string number_text(double value, int significant_digits = 9);

// "1 frame", "2 frames": the thing, or the things (the thing and an s, where they are not named), with their number.
std::string counted(std::size_t count, std::string_view thing, std::string_view things = {});

// The candidate nearest to a misspelt name by edit distance; nothing when none is within a third of the
// name's length (at least 1). The earliest wins a tie.
std::optional<std::string> nearest_name(std::string_view name, std::span<const std::string> candidates);

// " (did you mean 'x'?)", or empty when nothing is near: to be put behind a message.
std::string did_you_mean(std::string_view name, std::span<const std::string> candidates);

}  // namespace lightstage::core
