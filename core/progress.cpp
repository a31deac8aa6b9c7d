#include "core/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <exception>
#include <mutex>
#include <new>

#include "core/clock.h"
#include "core/printable.h"
#include "core/progress_bar/line.h"

namespace lightstage::core {

namespace {

constexpr Nanoseconds kBarInterval = 100 * kMillisecond;
constexpr Nanoseconds kLineInterval = 5 * kSecond;

void write_to_stderr(std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(STDERR_FILENO, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return;  // nobody can be told
    text.remove_prefix(static_cast<std::size_t>(n));
  }
}

// stderr, shared by all bars and notes of the process.
class Console {
 public:
  static Console& instance() {
    static Console console;
    return console;
  }

  std::atomic<bool> quiet{false};

  static bool is_terminal() { return isatty(STDERR_FILENO) == 1; }

  // Whole lines. A bar on the terminal moves down.
  void print_line(std::string_view line) {
    const std::lock_guard lock(mutex_);
    std::string text = bar_.empty() ? "" : "\r\x1b[K";
    text += printable_lines(line);
    text += '\n';
    write_to_stderr(text + bar_);
  }

  void draw_bar(std::string bar) {
    const std::lock_guard lock(mutex_);
    bar_ = std::move(bar);
    write_to_stderr("\r" + bar_ + "\x1b[K");
  }

  void clear_bar() {
    const std::lock_guard lock(mutex_);
    if (bar_.empty()) return;
    bar_.clear();
    write_to_stderr("\r\x1b[K");
  }

  static std::size_t columns() {
    winsize size{};
    const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1;
    return known ? size.ws_col - 1U : 79U;  // a full last column would wrap
  }

 private:
  std::mutex mutex_;
  std::string bar_;  // what the terminal's last line shows
};

}  // namespace

void set_quiet(bool quiet) {
  Console::instance().quiet = quiet;
}

void note(std::string_view text) {
  if (!Console::instance().quiet) Console::instance().print_line(text);
}

void warn(std::string_view text) {
  Console::instance().print_line("warning: " + std::string(text));
}

struct Progress::State {
  std::string label;
  std::size_t total;
  Nanoseconds start = SystemClock().now();
  int exceptions_at_start = std::uncaught_exceptions();
  std::atomic<std::size_t> done{0};
  std::atomic<Nanoseconds> next_show{0};
  std::mutex status_mutex;
  std::string status;

  // Calls show(reading) with what there is to say now.
  template <class Show>
  void with_reading(const Show& show) {
    std::string status_now;
    {
      const std::lock_guard lock(status_mutex);
      status_now = status;
    }
    const double elapsed = double(SystemClock().now() - start) / double(kSecond);
    const std::size_t by_now = done.load();
    // There may be more to do than was known.
    show(progress_bar::Reading{label, by_now, total == 0 ? 0 : std::max(total, by_now), elapsed, status_now});
  }

  void show_if_due() {
    Console& console = Console::instance();
    if (console.quiet) return;
    const Nanoseconds now = SystemClock().now();
    Nanoseconds due = next_show.load();
    const bool terminal = Console::is_terminal();
    // Of several threads that find it due, one shows it.
    if (now < due || !next_show.compare_exchange_strong(due, now + (terminal ? kBarInterval : kLineInterval))) return;
    with_reading([&](const progress_bar::Reading& reading) {
      if (terminal)
        console.draw_bar(progress_bar::bar_line(reading, Console::columns()));
      else
        console.print_line(progress_bar::plain_line(reading));
    });
  }
};

Progress::Progress(std::string label, std::size_t total) : state_(std::make_unique<State>()) {
  state_->label = printable(label);
  state_->total = total;
  // A log needs no line about work that has only begun.
  state_->next_show = state_->start + (Console::is_terminal() ? 0 : kLineInterval);
}

Progress::~Progress() {
  Console& console = Console::instance();
  if (console.quiet) return;
  const bool finished = std::uncaught_exceptions() <= state_->exceptions_at_start;
  try {
    console.clear_bar();
    state_->with_reading(
        [&](const progress_bar::Reading& r) { console.print_line(progress_bar::end_line(r, finished)); });
  } catch (const std::bad_alloc&) {
    // For want of memory a line is missing, no more.
  }
}

void Progress::advance(std::size_t n) {
  state_->done += n;
  state_->show_if_due();
}

void Progress::set_status(std::string_view text) {
  {
    const std::lock_guard lock(state_->status_mutex);
    state_->status = printable(text);
  }
  state_->show_if_due();
}

}  // namespace lightstage::core
