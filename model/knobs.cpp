#include "model/knobs.h"

#include <algorithm>
#include <utility>

#include "core/error.h"
#include "core/text.h"

namespace lightstage::model {

namespace {

constexpr int kMostMegabytes = 1 << 24;

std::string range(double lowest, double highest) {
  return core::number_text(lowest) + ".." + core::number_text(highest);
}

[[noreturn]] void refuse(const std::string& option, const std::string& text, const std::string& wanted) {
  throw core::UsageError(option + ": '" + text + "' is not " + wanted);
}

// A number's text that NaN does not pass.
double number_in(const std::string& option, const std::string& text, double lowest, double highest) {
  const std::optional<double> value = core::parse_number(text);
  if (!value || !(*value >= lowest && *value <= highest))
    refuse(option, text, "a number from " + core::number_text(lowest) + " to " + core::number_text(highest));
  return *value;
}

std::int64_t whole_number_in(const std::string& option, const std::string& text, std::int64_t lowest,
                             std::int64_t highest) {
  const std::optional<std::int64_t> value = core::parse_integer(text);
  if (!value || *value < lowest || *value > highest)
    refuse(option, text, "a whole number from " + std::to_string(lowest) + " to " + std::to_string(highest));
  return *value;
}

}  // namespace

Knob whole_number_knob(std::string option, std::string what, KnobPlace<int> place, int lowest, int highest) {
  MethodOptions fresh;
  auto set = [=](MethodOptions& options, const std::string& text) {
    place(options) = int(whole_number_in(option, text, lowest, highest));
  };
  return {option, std::move(what), std::to_string(place(fresh)), range(lowest, highest), false, std::move(set)};
}

Knob number_knob(std::string option, std::string what, KnobPlace<double> place, double lowest, double highest) {
  MethodOptions fresh;
  auto set = [=](MethodOptions& options, const std::string& text) {
    place(options) = number_in(option, text, lowest, highest);
  };
  return {option, std::move(what), core::number_text(place(fresh)), range(lowest, highest), false, std::move(set)};
}

Knob number_knob(std::string option, std::string what, KnobPlace<std::optional<double>> place, std::string otherwise,
                 double lowest, double highest) {
  auto set = [=](MethodOptions& options, const std::string& text) {
    place(options) = number_in(option, text, lowest, highest);
  };
  return {option, std::move(what), std::move(otherwise), range(lowest, highest), false, std::move(set)};
}

Knob megabytes_knob(std::string option, std::string what, KnobPlace<std::size_t> bytes) {
  MethodOptions fresh;
  auto set = [=](MethodOptions& options, const std::string& text) {
    bytes(options) = std::size_t(whole_number_in(option, text, 0, kMostMegabytes)) << 20;
  };
  return {option, std::move(what), std::to_string(bytes(fresh) >> 20), range(0, kMostMegabytes), false, std::move(set)};
}

Knob flag_knob(std::string option, std::string what, KnobPlace<bool> place) {
  auto set = [=](MethodOptions& options, const std::string& text) {
    place(options) = chosen_index(option, {"off", "on"}, text) == 1;
  };
  return {option, std::move(what), "off", "on|off", true, std::move(set)};
}

std::size_t chosen_index(const std::string& option, const std::vector<std::string>& names, const std::string& text) {
  const auto found = std::find(names.begin(), names.end(), text);
  if (found == names.end())
    refuse(option, text, "one of " + core::joined(names, ", ") + core::did_you_mean(text, names));
  return std::size_t(found - names.begin());
}

}  // namespace lightstage::model
