// libgpiod's first API (1.x): the only file that knows it.
#include <gpiod.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "capture/gpio/lines.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {

namespace fs = std::filesystem;

constexpr const char* kConsumer = "lightstage";  // what other programs are told of who holds a line

struct CloseChip {
  void operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }
};
using Chip = std::unique_ptr<gpiod_chip, CloseChip>;  // its end releases the lines requested of it

// The call that failed left its reason in errno.
std::string reason() {
  switch (errno) {
    case EACCES:
    case EPERM:
      return "no permission: install the udev rules (docs/hardware.md), or join the group that owns it";
    case ENODEV:
    case ENXIO:
      return "gone: was it unplugged?";
    case EIO:
      return "the chip does not answer, or refuses (input/output error)";
    default:
      return std::strerror(errno);
  }
}

[[noreturn]] void fail(const GpioRequest& request, const std::string& what) {
  throw core::DeviceError(describe(request) + ": " + what + ": " + reason());
}

// Paths of the chips in order of their numbers.
std::vector<std::string> chip_paths() {
  const std::string prefix = "gpiochip";
  std::vector<std::pair<std::int64_t, std::string>> chips;
  std::error_code no_folder;
  for (const fs::directory_entry& entry : fs::directory_iterator("/dev", no_folder)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(prefix)) continue;
    const auto number = core::parse_integer(std::string_view(name).substr(prefix.size()));
    if (number) chips.emplace_back(*number, entry.path().string());
  }
  std::sort(chips.begin(), chips.end());
  std::vector<std::string> paths;
  for (auto& [number, path] : chips) paths.push_back(std::move(path));
  return paths;
}

// libgpiod's own search by label gives up when there is any chip that this user may not open.
Chip find_chip(const GpioRequest& request) {
  Chip found;
  std::string found_path, closed, labels;
  for (const std::string& path : chip_paths()) {
    Chip chip(gpiod_chip_open(path.c_str()));
    if (chip == nullptr) {
      closed += "; " + path + ": " + reason();
      continue;
    }
    const std::string label = gpiod_chip_label(chip.get());
    labels += (labels.empty() ? "" : ", ") + label;
    if (path == request.chip) return chip;
    if (label != request.chip) continue;
    if (found != nullptr) {
      throw core::DeviceError(describe(request) + ": " + found_path + " and " + path +
                              " both have this label: name one by its path");
    }
    found = std::move(chip);
    found_path = path;
  }
  if (found == nullptr) {
    throw core::DeviceError(describe(request) + ": no such chip is plugged in (there are: " +
                            (labels.empty() ? "none" : labels) + closed + ")");
  }
  return found;
}

gpiod_line* line_by_name(gpiod_chip* chip, const GpioRequest& request, const std::string& name) {
  gpiod_line* found = nullptr;
  for (unsigned i = 0; i < gpiod_chip_num_lines(chip); ++i) {
    gpiod_line* line = gpiod_chip_get_line(chip, i);
    if (line == nullptr) fail(request, "line " + std::to_string(i));
    const char* its_name = gpiod_line_name(line);
    if (its_name == nullptr || name != its_name) continue;
    if (found != nullptr) {
      throw core::DeviceError(describe(request) + ": two lines are named '" + name + "': give the line's number");
    }
    found = line;
  }
  return found;
}

gpiod_line* find_line(gpiod_chip* chip, const GpioRequest& request, const std::string& name_or_number) {
  if (gpiod_line* line = line_by_name(chip, request, name_or_number)) return line;
  const unsigned count = gpiod_chip_num_lines(chip);
  const auto number = core::parse_integer(name_or_number);
  if (!number || *number < 0 || *number >= count) {
    throw core::DeviceError(describe(request) + ": the chip has no line '" + name_or_number + "': it has " +
                            std::to_string(count) + ", from 0 (see `lightstage doctor`)");
  }
  gpiod_line* line = gpiod_chip_get_line(chip, static_cast<unsigned>(*number));
  if (line == nullptr) fail(request, "line " + name_or_number);
  return line;
}

std::string holder(gpiod_line* line) {
  const char* consumer = gpiod_line_consumer(line);
  return consumer == nullptr || *consumer == '\0' ? "another program or the kernel" : "'" + std::string(consumer) + "'";
}

// A chip and lines of it that are held.
struct HeldLines {
  HeldLines(const GpioRequest& wanted, int request_type) : request(wanted), chip(find_chip(wanted)) {
    if (request.lines.empty() || request.lines.size() > GPIOD_LINE_BULK_MAX_LINES) {
      throw core::DeviceError(describe(request) + ": 1 to 64 lines can be held together");
    }
    gpiod_line_bulk_init(&lines);
    for (const std::string& name : request.lines) gpiod_line_bulk_add(&lines, find_line(chip.get(), request, name));
    const gpiod_line_request_config config{kConsumer, request_type,
                                           request.active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0};
    const std::vector<int> inactive(request.lines.size(), 0);
    if (gpiod_line_request_bulk(&lines, &config, inactive.data()) == 0) return;
    if (errno == EBUSY) fail_as_held();
    fail(request, "cannot take the line");
  }

  [[noreturn]] void fail_as_held() {
    for (unsigned i = 0; i < gpiod_line_bulk_num_lines(&lines); ++i) {
      gpiod_line* line = gpiod_line_bulk_get_line(&lines, i);
      if (gpiod_line_update(line) != 0 || !gpiod_line_is_used(line)) continue;
      throw core::DeviceError(describe(request) + ": line " + request.lines[i] + " is held by " + holder(line) +
                              ": end it, or choose another line");
    }
    throw core::DeviceError(describe(request) + ": held by another program or the kernel");
  }

  GpioRequest request;
  Chip chip;
  gpiod_line_bulk lines{};
};

class Outputs final : public GpioOutputs {
 public:
  explicit Outputs(const GpioRequest& request) : held_(request, GPIOD_LINE_REQUEST_DIRECTION_OUTPUT) {}

  void set(bool active) override {
    const std::vector<int> values(held_.request.lines.size(), active ? 1 : 0);
    if (gpiod_line_set_value_bulk(&held_.lines, values.data()) != 0) fail(held_.request, "cannot set");
  }

  std::vector<bool> read() override {
    std::vector<int> values(held_.request.lines.size());
    if (gpiod_line_get_value_bulk(&held_.lines, values.data()) != 0) fail(held_.request, "cannot read back");
    return {values.begin(), values.end()};
  }

 private:
  HeldLines held_;
};

core::Nanoseconds nanoseconds(const timespec& time) {
  return core::Nanoseconds(time.tv_sec) * core::kSecond + time.tv_nsec;
}

class Edges final : public GpioEdges {
 public:
  // With "active low" the kernel swaps the edges: rising is always "becomes active".
  explicit Edges(const GpioRequest& request) : held_(request, GPIOD_LINE_REQUEST_EVENT_RISING_EDGE) {}

  std::optional<core::Nanoseconds> next_edge(core::Nanoseconds timeout) override {
    const timespec limit{timeout / core::kSecond, timeout % core::kSecond};
    const int ready = gpiod_line_event_wait(line(), &limit);
    if (ready < 0 && errno != EINTR) fail(held_.request, "cannot wait for an edge");
    if (ready <= 0) return {};
    gpiod_line_event event{};
    if (gpiod_line_event_read(line(), &event) != 0) fail(held_.request, "cannot read an edge");
    return nanoseconds(event.ts);
  }

  void check() override {
    if (gpiod_line_get_value(line()) < 0) fail(held_.request, "cannot be read");
  }

 private:
  gpiod_line* line() { return gpiod_line_bulk_get_line(&held_.lines, 0); }

  HeldLines held_;
};

class SystemChips final : public GpioChips {
 public:
  std::unique_ptr<GpioOutputs> open_outputs(const GpioRequest& request) override {
    return std::make_unique<Outputs>(request);
  }
  std::unique_ptr<GpioEdges> open_edges(const GpioRequest& request) override {
    return std::make_unique<Edges>(request);
  }
};

GpioLineSeen look_at(gpiod_line* line) {
  const auto text = [](const char* words) { return std::string(words == nullptr ? "" : words); };
  return {.name = text(gpiod_line_name(line)),
          .output = gpiod_line_direction(line) == GPIOD_LINE_DIRECTION_OUTPUT,
          .used = gpiod_line_is_used(line),
          .consumer = text(gpiod_line_consumer(line))};
}

}  // namespace

std::unique_ptr<GpioChips> system_gpio_chips() {
  return std::make_unique<SystemChips>();
}

std::vector<GpioChipSeen> gpio_chips_seen() {
  std::vector<GpioChipSeen> seen;
  for (const std::string& path : chip_paths()) {
    GpioChipSeen& entry = seen.emplace_back();
    entry.path = path;
    const Chip chip(gpiod_chip_open(path.c_str()));
    if (chip == nullptr) {
      entry.problem = reason();
      continue;
    }
    entry.label = gpiod_chip_label(chip.get());
    for (unsigned i = 0; i < gpiod_chip_num_lines(chip.get()); ++i) {
      gpiod_line* line = gpiod_chip_get_line(chip.get(), i);
      if (line == nullptr) {
        entry.problem = "line " + std::to_string(i) + ": " + reason();
        break;
      }
      entry.lines.push_back(look_at(line));
    }
  }
  return seen;
}

}  // namespace lightstage::capture
