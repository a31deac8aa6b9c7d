// Makers of knobs, for the table of methods.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "model/methods.h"

namespace lightstage::model {

// Where a knob's value stands in the options. Its default is what stands there in fresh ones.
template <class Value>
using KnobPlace = Value& (*)(MethodOptions& options);

Knob whole_number_knob(std::string option, std::string what, KnobPlace<int> place, int lowest, int highest);
Knob number_knob(std::string option, std::string what, KnobPlace<double> place, double lowest, double highest);
// Left open, the value comes from where `otherwise` says.
Knob number_knob(std::string option, std::string what, KnobPlace<std::optional<double>> place, std::string otherwise,
                 double lowest, double highest);
Knob megabytes_knob(std::string option, std::string what, KnobPlace<std::size_t> bytes);
Knob flag_knob(std::string option, std::string what, KnobPlace<bool> place);

// Which of the names the text is. Throws UsageError naming the option.
std::size_t chosen_index(const std::string& option, const std::vector<std::string>& names, const std::string& text);

// The names of an enumeration whose values count from 0.
template <class Enumeration>
Knob choice_knob(std::string option, std::string what, KnobPlace<Enumeration> place, std::vector<std::string> names) {
  MethodOptions fresh;
  std::string values;
  for (const std::string& name : names) values += (values.empty() ? "" : "|") + name;
  Knob knob{option, std::move(what), names[std::size_t(place(fresh))], std::move(values), false, {}};
  knob.set = [option, place, names = std::move(names)](MethodOptions& options, const std::string& text) {
    place(options) = static_cast<Enumeration>(chosen_index(option, names, text));
  };
  return knob;
}

}  // namespace lightstage::model
