#include <fstream>
#include <sstream>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "capture/devices_seen.h"
#include "capture/stage.h"
#include "cli/commands.h"
#include "cli/report/devices.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/text.h"
#include "core/version.h"
#include "model/engine_info.h"

namespace lightstage::cli {

namespace {

// The vector extensions of the first processor that matter to the network's speed.
std::vector<std::string> cpu_features() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with("flags")) continue;
    std::vector<std::string> found;
    std::istringstream words(line.substr(line.find(':') + 1));
    for (std::string word; words >> word;) {
      for (const char* wanted : {"avx2", "fma", "avx512f", "avx512_bf16", "avx512_vnni", "amx_bf16"}) {
        if (word == wanted) found.push_back(word);
      }
    }
    return found;
  }
  return {};
}

std::string lines_of(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  return text;
}

void run_doctor(const std::filesystem::path& stage_file, Context& context) {
  std::optional<capture::Stage> stage;
  if (!stage_file.empty()) stage = capture::read_stage(stage_file);
  const model::EngineInfo engine = model::engine_info();
  const capture::DevicesSeen devices = capture::devices_seen();
  std::vector<std::string> problems = capture::device_problems(devices);
  if (!engine.fast_blas) {
    problems.insert(problems.begin(), "the BLAS is the slow reference one: install libopenblas0-pthread");
  }
  const std::vector<std::string> of_stage =
      stage ? capture::stage_problems(*stage, devices) : std::vector<std::string>();

  const std::string features = core::joined(cpu_features(), " ");
  const std::vector<std::pair<std::string, std::string>> rows{
      {"version", core::kVersion},
      {"threads", std::to_string(core::thread_count())},
      {"libtorch", engine.torch_version},
      {"BLAS", engine.blas},
      {"CPU", features.empty() ? "no vector extensions seen" : features}};
  std::string text;
  for (const auto& [name, value] : rows) text += name + std::string(11 - name.size(), ' ') + value + "\n";
  text += devices_text(devices) + lines_of(problems) + lines_of(of_stage);
  if (problems.empty() && of_stage.empty()) {
    text += stage ? "no problems found: stage '" + stage->name + "' can be captured with\n" : "no problems found\n";
  }

  nlohmann::ordered_json json{{"version", core::kVersion},     {"threads", core::thread_count()},
                              {"torch", engine.torch_version}, {"blas", engine.blas},
                              {"fast_blas", engine.fast_blas}, {"cpu", cpu_features()}};
  json.update(devices_json(devices));
  json["problems"] = problems;
  if (stage) json["stage_problems"] = of_stage;
  json["ok"] = problems.empty() && of_stage.empty();
  context.result(text, json);
  if (!of_stage.empty()) {
    throw core::DeviceError(stage_file.string() + ": " + std::to_string(of_stage.size()) +
                            (of_stage.size() == 1 ? " thing keeps" : " things keep") +
                            " the stage from running with the devices that are plugged in");
  }
}

}  // namespace

void add_doctor(CLI::App& program, Context& context) {
  CLI::App* command =
      program.add_subcommand("doctor", "What this machine offers, what is wrong with it, and how to mend it");
  command->footer(
      "Examples:\n"
      "  lightstage doctor\n"
      "  lightstage doctor --stage stage.toml        (are the stage's devices there, and as described?)");
  auto stage_file = std::make_shared<std::filesystem::path>();
  command->add_option("--stage", *stage_file, "Compare this stage file with the devices that are plugged in");
  command->callback([stage_file, &context] { run_doctor(*stage_file, context); });
}

}  // namespace lightstage::cli
