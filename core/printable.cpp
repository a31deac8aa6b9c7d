#include "core/printable.h"

#include <cstdint>
#include <cstdio>

namespace lightstage::core {

namespace {

struct Character {
  std::size_t bytes = 1;
  std::uint32_t code = 0;
  bool valid = false;
};

// The first character of a text that is not empty (The Unicode Standard, table 3-7: no overlong forms, no surrogates).
Character first_character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return std::uint32_t(static_cast<unsigned char>(text[i])); };
  const std::uint32_t lead = byte(0);
  if (lead < 0x80) return {1, lead, true};
  const std::size_t length = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
  if (lead < 0xC2 || lead > 0xF4 || text.size() < length) return {};
  std::uint32_t code = lead & (0xFFu >> (length + 1));
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return {};
    code = code << 6 | (byte(i) & 0x3F);
  }
  constexpr std::uint32_t kLeast[] = {0, 0, 0x80, 0x800, 0x10000};
  if (code < kLeast[length] || code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF)) return {};
  return {length, code, true};
}

// Unicode Standard Annex 9: embeddings, overrides, isolates and the marks.
bool turns_order(std::uint32_t code) {
  return (code >= 0x202A && code <= 0x202E) || (code >= 0x2066 && code <= 0x2069) || code == 0x200E || code == 0x200F ||
         code == 0x061C;
}

bool is_control(std::uint32_t code) {
  return code < 0x20 || (code >= 0x7F && code < 0xA0) || code == 0x2028 || code == 0x2029;
}

void append_escaped(std::string& to, std::string_view bytes, const Character& character) {
  char text[16];
  if (character.valid && character.code > 0xFF) {
    std::snprintf(text, sizeof text, "\\u%04x", unsigned(character.code));
    to += text;
    return;
  }
  for (const char c : bytes) {
    std::snprintf(text, sizeof text, "\\x%02x", unsigned(static_cast<unsigned char>(c)));
    to += c == '\n' ? "\\n" : c == '\t' ? "\\t" : c == '\r' ? "\\r" : text;
  }
}

std::string shown(std::string_view text, bool keep_lines) {
  std::string result;
  result.reserve(text.size());
  while (!text.empty()) {
    const Character character = first_character(text);
    const std::string_view bytes = text.substr(0, character.bytes);
    text.remove_prefix(character.bytes);
    const bool layout = keep_lines && (bytes == "\n" || bytes == "\t");
    if (layout || (character.valid && !is_control(character.code) && !turns_order(character.code))) {
      result += bytes;
    } else {
      append_escaped(result, bytes, character);
    }
  }
  return result;
}

}  // namespace

std::string printable(std::string_view text) {
  return shown(text, false);
}

std::string printable_lines(std::string_view text) {
  return shown(text, true);
}

std::string quoted(std::string_view name) {
  constexpr std::size_t kLongest = 200, kBeginning = 60;
  if (name.size() <= kLongest) return "'" + printable(name) + "'";
  std::size_t end = kBeginning;  // not in the middle of a character
  while (end > 0 && (static_cast<unsigned char>(name[end]) & 0xC0) == 0x80) --end;
  return "'" + printable(name.substr(0, end)) + "...' (" + std::to_string(name.size()) + " bytes)";
}

}  // namespace lightstage::core
