// "Did you mean ...?" for names that users type.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace lightstage::core {

// The candidate with the fewest edits (insertions, deletions, substitutions, swaps of neighbours) from `name`, first one on a tie; empty when
// there is no candidate or the nearest differs in more than half of its letters.
std::string nearest_name(std::string_view name, std::span<const std::string> candidates);

// " (did you mean 'x'?)", or empty when nothing is near: to be put behind a message.
std::string did_you_mean(std::string_view name, std::span<const std::string> candidates);

}  // namespace lightstage::core
