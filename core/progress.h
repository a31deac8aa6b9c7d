// Progress on stderr: a bar with the time left on a terminal, plain lines now and then otherwise.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

namespace lightstage::core {

// --quiet: progress and notes are not printed (warnings are).
void set_quiet(bool quiet);

// One line each on stderr; a bar that is being drawn is kept whole. May be called from any thread.
void note(std::string_view text);
void warn(std::string_view text);

// Counts work done. Lines appear at most ten times a second on a terminal and about every 5 seconds
// otherwise, plus one at the end with the time taken. May be advanced from several threads.
class Progress {
 public:
  // `total` 0 means that it is not known. More may be done than it says: it is then what was done.
  Progress(std::string label, std::size_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void advance(std::size_t n = 1);
  // Text after the bar, such as a loss or a rate.
  void set_status(std::string_view text);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace lightstage::core
