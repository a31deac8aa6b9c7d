// What options of several commands share.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/direction.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::cli {

// A finite number from `lowest` to `highest`; CLI::Range would let NaN pass.
inline CLI::Validator number_between(double lowest, double highest) {
  CLI::Validator validator;
  const std::string range = CLI::detail::to_string(lowest) + " to " + CLI::detail::to_string(highest);
  validator.description(range).operation([=](std::string& text) {
    double value = 0;
    if (CLI::detail::lexical_cast(text, value) && value >= lowest && value <= highest) return std::string();
    return "'" + text + "' is not a number from " + range;
  });
  return validator;
}

// One of these names, which the option's own text lists. (CLI11's own would take the numbers behind them too, and show those.)
template <typename Value>
CLI::Validator one_of(const std::map<std::string, Value>& names) {
  return {[names](std::string& text) {
            const auto found = names.find(text);
            if (found != names.end()) {
              text = std::to_string(static_cast<std::int64_t>(found->second));
              return std::string();
            }
            std::vector<std::string> known;
            for (const auto& [name, value] : names) known.push_back(name);
            return "'" + text + "' is none of " + core::joined(known, ", ") + core::did_you_mean(text, known);
          },
          ""};
}

// core::parse_direction of an option's value: what is wrong with it is the command line's fault.
inline core::Direction direction_option(const std::string& option, const std::string& text) {
  try {
    return core::parse_direction(text);
  } catch (const core::BadInput& error) {
    throw core::UsageError(option + ": " + error.what());
  }
}

// null where there is no value.
template <typename Value>
nlohmann::ordered_json or_null(const std::optional<Value>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(nullptr);
}

// One line of JSON, whatever bytes file names in it are made of.
inline std::string json_text(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace lightstage::cli
