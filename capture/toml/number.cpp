#include "capture/toml/number.h"

#include <array>
#include <charconv>

namespace lightstage::capture {

std::string toml_number(double value) {
  std::array<char, 32> digits;
  const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  std::string text(digits.data(), end);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return text;
}

}  // namespace lightstage::capture
