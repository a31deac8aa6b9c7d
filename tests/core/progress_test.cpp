#include "core/progress.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <cstdio>
#include <stdexcept>
#include <thread>
#include <vector>

#include "core/progress_bar/line.h"

#include "support/support.h"

using namespace lightstage;
using core::progress_bar::Reading;

namespace {

// Runs `function` with `file` in the place of stderr.
template <class Function>
void with_stderr(int file, const Function& function) {
  const int saved = dup(STDERR_FILENO);
  dup2(file, STDERR_FILENO);
  function();
  dup2(saved, STDERR_FILENO);
  close(saved);
}

// What a function writes to stderr, which is a file meanwhile and no terminal.
template <class Function>
std::string stderr_of(const Function& function) {
  std::FILE* file = std::tmpfile();
  REQUIRE(file != nullptr);
  with_stderr(fileno(file), function);
  std::rewind(file);
  std::string text;
  for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file)) text += char(c);
  std::fclose(file);
  return text;
}

// The same on a terminal of 60 columns. What is written must fit its buffer of some kilobytes.
template <class Function>
std::string terminal_output_of(const Function& function) {
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
  REQUIRE(terminal >= 0);
  REQUIRE(grantpt(terminal) == 0);
  REQUIRE(unlockpt(terminal) == 0);
  const int program_side = open(ptsname(terminal), O_RDWR | O_NOCTTY);
  REQUIRE(program_side >= 0);
  winsize size{};
  size.ws_col = 60;
  size.ws_row = 24;
  ioctl(program_side, TIOCSWINSZ, &size);
  with_stderr(program_side, function);
  std::string text;
  char block[4096];
  for (ssize_t n = read(terminal, block, sizeof block); n > 0; n = read(terminal, block, sizeof block))
    text.append(block, std::size_t(n));
  close(program_side);
  close(terminal);
  return text;
}

}  // namespace

TEST_CASE("durations are written as people read them") {
  using core::progress_bar::duration_text;
  CHECK(duration_text(0) == "0:00");
  CHECK(duration_text(7.4) == "0:07");
  CHECK(duration_text(59.6) == "1:00");
  CHECK(duration_text(754) == "12:34");
  CHECK(duration_text(3723) == "1:02:03");
  CHECK(duration_text(-5) == "0:00");
  CHECK(duration_text(1e300).size() < 40);
}

TEST_CASE("a bar shows how far and how long, within the terminal's width") {
  const Reading half{"train", 50, 100, 30, "loss 0.1"};
  const std::string line = core::progress_bar::bar_line(half, 79);
  CHECK(line == "train [############............]  50% 50/100 0:30 left loss 0.1");
  CHECK(core::progress_bar::bar_line(half, 10) == "train [###");
  CHECK(core::progress_bar::bar_line({"é€", 0, 0, 0, ""}, 1) == "é");
  CHECK(core::progress_bar::bar_line({"x", 3, 0, 1, ""}, 79) == "x 3");
  CHECK(core::progress_bar::bar_line({"x", 0, 10, 5, ""}, 79) == "x [........................]   0% 0/10");
  CHECK(core::progress_bar::bar_line({"x", 12, 10, 5, ""}, 79) == "x [########################] 100% 12/10");
}

TEST_CASE("a log gets plain lines and one at the end with the time taken") {
  const Reading half{"train", 50, 100, 30, "loss 0.1"};
  CHECK(core::progress_bar::plain_line(half) == "train: 50/100, 0:30 left, loss 0.1");
  CHECK(core::progress_bar::end_line({"x", 5, 5, 1.25, ""}, true) == "x: 5/5 in 1.2 s");
  CHECK(core::progress_bar::end_line({"x", 2, 5, 1.25, ""}, false) == "x: 2/5, stopped after 1.2 s");

  const std::string text = stderr_of([] {
    core::Progress progress("frames", 200);
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t)
      threads.emplace_back([&] {
        for (int i = 0; i < 50; ++i) progress.advance();
      });
    for (std::thread& t : threads) t.join();
    progress.set_status("ok");
    core::note("a note");
  });
  CHECK(text.starts_with("a note\nframes: 200/200 in "));
  CHECK(text.ends_with("s, ok\n"));
  CHECK(std::count(text.begin(), text.end(), '\n') == 2);
  CHECK(text.find('\r') == std::string::npos);
}

TEST_CASE("a terminal gets a bar that is redrawn in place, and notes stand above it") {
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY);
  if (terminal < 0) SKIP_TEST("there are no pseudo-terminals here");
  close(terminal);
  const std::string text = terminal_output_of([] {
    core::Progress progress("frames", 4);
    progress.advance();  // the first is drawn at once
    progress.advance();  // too soon for another
    core::note("a note");
    std::this_thread::sleep_for(std::chrono::milliseconds(120));
    progress.set_status(std::string(100, 's'));
    progress.advance(2);
  });
  const std::string bar = "\rframes [######..................]  25% 1/4 0:00 left\x1b[K";
  CHECK(text.starts_with(bar + "\r\x1b[Ka note\r\nframes [######"));
  CHECK(text.find("2/4 0:00 left sss") != std::string::npos);
  CHECK(text.find("sssssssssssssssss\x1b[K") == std::string::npos);  // cut at the terminal's width
  const std::size_t end = text.rfind("\r\x1b[Kframes: 4/4 in 0.");
  CHECK(end != std::string::npos);
  CHECK(std::count(text.begin(), text.end(), '\n') == 2);
}

TEST_CASE("work that is given up says so") {
  const std::string text = stderr_of([] {
    try {
      core::Progress progress("frames", 3);
      progress.advance();
      throw std::runtime_error("camera gone");
    } catch (const std::runtime_error&) {
    }
  });
  CHECK(text.starts_with("frames: 1/3, stopped after "));
}

TEST_CASE("quiet leaves only warnings") {
  core::set_quiet(true);
  const std::string text = stderr_of([] {
    core::Progress progress("frames", 1);
    progress.advance();
    core::note("a note");
    core::warn("lamp 3 is dim");
  });
  core::set_quiet(false);
  CHECK(text == "warning: lamp 3 is dim\n");
}
