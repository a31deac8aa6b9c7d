#include "core/progress_bar/line.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace lightstage::core::progress_bar {

namespace {

constexpr std::size_t kBarCells = 24;

double fraction(const Reading& r) {
  return r.total == 0 ? 0 : std::min(1.0, double(r.done) / double(r.total));
}

std::string counts_text(const Reading& r) {
  return r.total == 0 ? std::to_string(r.done) : std::to_string(r.done) + "/" + std::to_string(r.total);
}

// Empty until there is a rate to judge by.
std::string time_left_text(const Reading& r) {
  if (r.total == 0 || r.done == 0 || r.done >= r.total) return "";
  return duration_text(r.elapsed_seconds / double(r.done) * double(r.total - r.done)) + " left";
}

std::string cut_to_columns(std::string text, std::size_t columns) {
  std::size_t characters = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool starts_character = (static_cast<unsigned char>(text[i]) & 0xC0U) != 0x80U;
    if (starts_character && characters++ == columns) {
      text.resize(i);
      break;
    }
  }
  return text;
}

}  // namespace

std::string duration_text(double seconds) {
  const long long whole = std::llround(std::clamp(seconds, 0.0, 1e12));
  char text[48];
  if (whole < 3600)
    std::snprintf(text, sizeof text, "%lld:%02lld", whole / 60, whole % 60);
  else
    std::snprintf(text, sizeof text, "%lld:%02lld:%02lld", whole / 3600, whole / 60 % 60, whole % 60);
  return text;
}

std::string bar_line(const Reading& r, std::size_t columns) {
  std::string line(r.label);
  if (r.total > 0) {
    const std::size_t filled = static_cast<std::size_t>(fraction(r) * double(kBarCells));
    char percent[16];
    std::snprintf(percent, sizeof percent, "%3d%%", static_cast<int>(100 * fraction(r)));
    line.append(" [").append(filled, '#').append(kBarCells - filled, '.').append("] ").append(percent);
  }
  line.append(" ").append(counts_text(r));
  if (const std::string left = time_left_text(r); !left.empty()) line.append(" ").append(left);
  if (!r.status.empty()) line.append(" ").append(r.status);
  return cut_to_columns(std::move(line), columns);
}

std::string plain_line(const Reading& r) {
  std::string line = std::string(r.label) + ": " + counts_text(r);
  if (const std::string left = time_left_text(r); !left.empty()) line.append(", ").append(left);
  if (!r.status.empty()) line.append(", ").append(r.status);
  return line;
}

std::string end_line(const Reading& r, bool finished) {
  char seconds[32];
  std::snprintf(seconds, sizeof seconds, "%.1f s", r.elapsed_seconds);
  std::string line = std::string(r.label) + ": " + counts_text(r) + (finished ? " in " : ", stopped after ") + seconds;
  if (!r.status.empty()) line.append(", ").append(r.status);
  return line;
}

}  // namespace lightstage::core::progress_bar
