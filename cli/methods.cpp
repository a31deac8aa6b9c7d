#include "model/methods.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

void run_methods(Context& context) {
  std::string text;
  ordered_json list = ordered_json::array();
  for (const model::MethodInfo& method : model::methods()) {
    text += method.name + "\n  " + method.summary + "\n  " + method.citation + "\n";
    ordered_json knobs = ordered_json::array();
    for (const model::Knob& knob : method.knobs) {
      text += "  " + knob.option + (knob.flag ? "" : " " + knob.values) + ": " + knob.what + " [" + knob.default_value +
              "]\n";
      knobs.push_back(
          {{"option", knob.option}, {"what", knob.what}, {"default", knob.default_value}, {"values", knob.values}});
    }
    text += "\n";
    list.push_back(
        {{"name", method.name}, {"summary", method.summary}, {"citation", method.citation}, {"knobs", knobs}});
  }
  context.result(text, {{"methods", list}});
}

}  // namespace

void add_methods(CLI::App& program, Context& context) {
  CLI::App* command =
      program.add_subcommand("methods", "List the ways to a picture between the lights, and their knobs");
  command->footer("Example:\n  lightstage methods --json");
  command->callback([&context] { run_methods(context); });
}

}  // namespace lightstage::cli
