#include "core/nesting.h"

namespace lightstage::core {

bool json_nests_deeper(std::string_view json, int levels) {
  int level = 0;
  bool in_string = false, escaped = false;
  for (const char c : json) {
    if (in_string) {
      in_string = escaped || c != '"';
      escaped = !escaped && c == '\\';
      continue;
    }
    in_string = c == '"';
    if (c == '[' || c == '{') ++level;
    if (c == ']' || c == '}') --level;
    if (level > levels) return true;
  }
  return false;
}

namespace {

// The length of the string that begins at the start of `text` with a quote, with both quotes (TOML 1.0, "String"). One that is not closed ends with its
// line, where the parser stops too.
std::size_t string_length(std::string_view text) {
  const char quote = text[0];
  const bool escapes = quote == '"';
  const std::string_view three(quote == '"' ? "\"\"\"" : "'''");
  const bool many_lines = text.starts_with(three);
  for (std::size_t i = many_lines ? 3 : 1; i < text.size(); ++i) {
    if (escapes && text[i] == '\\') {
      ++i;
    } else if (many_lines && text.substr(i).starts_with(three)) {
      return i + 3;
    } else if (!many_lines && (text[i] == quote || text[i] == '\n')) {
      return i + (text[i] == quote ? 1 : 0);
    }
  }
  return text.size();
}

}  // namespace

int line_of_longer_key(std::string_view toml, int parts) {
  int line = 1, dots = 0;
  for (std::size_t i = 0; i < toml.size(); ++i) {
    const char c = toml[i];
    if (c == '#') {
      const std::size_t end = toml.find('\n', i);
      if (end == std::string_view::npos) return 0;
      i = end - 1;
    } else if (c == '"' || c == '\'') {
      const std::size_t length = string_length(toml.substr(i));
      for (const char inside : toml.substr(i, length)) line += inside == '\n' ? 1 : 0;
      i += length - 1;
    } else if (c == '.') {
      if (++dots >= parts) return line;
    } else if (c == '\n' || c == '=' || c == ',' || c == '[' || c == ']' || c == '{' || c == '}') {
      dots = 0;
      line += c == '\n' ? 1 : 0;
    }
  }
  return 0;
}

}  // namespace lightstage::core
