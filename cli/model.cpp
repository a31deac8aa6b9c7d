#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/scans.h"
#include "core/text.h"
#include "model/checkpoint.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

std::string joined(const std::vector<std::int64_t>& numbers) {
  std::string text;
  for (const std::int64_t number : numbers) text += (text.empty() ? "" : " x ") + std::to_string(number);
  return text.empty() ? "scalar" : text;
}

ordered_json configuration(const model::NetworkConfig& config) {
  return {{"architecture", model::architecture_name(config.architecture)},
          {"neighbours", config.neighbours},
          {"channels", config.channels},
          {"query_channels", config.query_channels},
          {"sharpness", config.sharpness},
          {"pooling", config.pooling == model::Pooling::kAliasFree ? "alias_free" : "average"}};
}

// As parsed JSON where it is JSON; a text of another kind, or none, as it stands.
ordered_json provenance(const std::string& text) {
  ordered_json parsed = ordered_json::parse(text, nullptr, /*allow_exceptions=*/false);
  return parsed.is_discarded() ? ordered_json(text) : parsed;
}

void run_show(const std::string& file_or_name, Context& context) {
  const std::filesystem::path file = file_or_shipped_model(file_or_name).value_or(file_or_name);
  const model::CheckpointInfo info = model::read_checkpoint_info(file);
  const ordered_json config = configuration(info.config), origin = provenance(info.provenance);

  std::string text = file.string() + ": " + std::to_string(info.parameters) + " parameters, " +
                     core::number_text(model::flop_per_pixel(info.config) / 1000, 4) +
                     " thousand operations a pixel and query\n\nconfiguration\n";
  const auto add_lines = [&](const ordered_json& json) {
    if (!json.is_object()) {
      text += "  " + (json.is_string() ? json.get<std::string>() : json.dump()) + "\n";
      return;
    }
    for (const auto& [key, value] : json.items()) {
      text += "  " + key + ": " + (value.is_string() ? value.get<std::string>() : value.dump()) + "\n";
    }
  };
  add_lines(config);
  ordered_json looks_at = ordered_json::array();
  if (const auto chosen = model::chosen_directions(file); !chosen.empty()) {
    text += "\nlooks at the lights nearest to (longitude, latitude)\n";
    for (const core::Direction& direction : chosen) {
      looks_at.push_back({direction.x(), direction.y(), direction.z()});
      text += "  " + fixed(direction.longitude_degrees(), 1) + ", " + fixed(direction.latitude_degrees(), 1) + "\n";
    }
  }
  text += "\nprovenance\n";
  add_lines(origin);

  std::vector<std::vector<std::string>> rows{{"tensor", "shape"}};
  ordered_json tensors = ordered_json::array();
  for (const model::TensorInfo& tensor : info.tensors) {
    rows.push_back({tensor.name, joined(tensor.shape)});
    tensors.push_back({{"name", tensor.name}, {"shape", tensor.shape}});
  }
  text += "\n" + table(rows);
  context.result(text, {{"file", file.string()},
                        {"configuration", config},
                        {"parameters", info.parameters},
                        {"flop_per_pixel", model::flop_per_pixel(info.config)},
                        {"looks_at", looks_at},
                        {"tensors", tensors},
                        {"provenance", origin}});
}

}  // namespace

void add_model(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("model", "Look into trained networks");
  command->footer("Example:\n  lightstage model show head.safetensors");
  command->require_subcommand(1);

  CLI::App* show = command->add_subcommand("show", "Print what a model file holds and where it comes from");
  show->fallthrough();
  show->footer("Example:\n  lightstage model show head.safetensors --json");
  auto file = std::make_shared<std::string>();
  show->add_option("FILE", *file, "A model file (.safetensors), or blend, the shipped one")->required();
  show->callback([file, &context] { run_show(*file, context); });
}

}  // namespace lightstage::cli
