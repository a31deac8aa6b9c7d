// What a progress line says, apart from where and when it is printed.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace lightstage::core::progress_bar {

struct Reading {
  std::string_view label;
  std::size_t done = 0;
  std::size_t total = 0;  // 0: not known
  double elapsed_seconds = 0;
  std::string_view status;
};

// "0:07", "12:34", "1:02:03"; rounded to seconds.
std::string duration_text(double seconds);

// For a terminal: a bar, the percentage, counts, the time left at the mean rate so far, and the status, cut
// to at most `columns` characters (UTF-8 sequences stay whole).
std::string bar_line(const Reading& reading, std::size_t columns);

// For a log: the same without the bar.
std::string plain_line(const Reading& reading);

// The closing line; `finished` false when the work was given up.
std::string end_line(const Reading& reading, bool finished);

}  // namespace lightstage::core::progress_bar
