#include <fstream>
#include <sstream>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "capture/devices_seen.h"
#include "cli/commands.h"
#include "core/parallel.h"
#include "core/version.h"
#include "model/engine_info.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

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

void run_doctor(Context& context) {
  const model::EngineInfo engine = model::engine_info();
  const std::vector<capture::DeviceSeen> devices = capture::devices_seen();
  ordered_json device_list = ordered_json::array();
  std::string problems;
  std::vector<std::vector<std::string>> rows{{"version", core::kVersion},
                                             {"threads", std::to_string(core::thread_count())},
                                             {"libtorch", engine.torch_version},
                                             {"BLAS", engine.blas}};
  std::string features;
  for (const std::string& feature : cpu_features()) features += (features.empty() ? "" : " ") + feature;
  rows.push_back({"CPU", features.empty() ? "no vector extensions seen" : features});
  if (!engine.fast_blas) {
    problems += "The BLAS is the slow reference one: install libopenblas0-pthread.\n";
  }
  for (const capture::DeviceSeen& device : devices) {
    rows.push_back({device.kind, device.path + (device.accessible ? "" : "  (no permission)")});
    device_list.push_back({{"kind", device.kind}, {"path", device.path}, {"accessible", device.accessible}});
    if (!device.accessible)
      problems += device.path + ": no permission; join the group that owns it, or add a udev rule.\n";
  }
  if (devices.empty()) rows.push_back({"devices", "no cameras (/dev/video*) or GPIO chips (/dev/gpiochip*) seen"});
  // Left-aligned text reads better here than the numbers' right alignment.
  std::string text;
  for (const auto& row : rows)
    text += row[0] + std::string(row[0].size() < 10 ? 10 - row[0].size() : 1, ' ') + row[1] + "\n";
  context.result(text + (problems.empty() ? "no problems found\n" : problems), {{"version", core::kVersion},
                                                                                {"threads", core::thread_count()},
                                                                                {"torch", engine.torch_version},
                                                                                {"blas", engine.blas},
                                                                                {"fast_blas", engine.fast_blas},
                                                                                {"cpu", cpu_features()},
                                                                                {"devices", device_list},
                                                                                {"ok", problems.empty()}});
}

}  // namespace

void add_doctor(CLI::App& program, Context& context) {
  CLI::App* command =
      program.add_subcommand("doctor", "What this machine offers: libraries, threads, processor, devices");
  command->footer("Example:\n  lightstage doctor --json");
  command->callback([&context] { run_doctor(context); });
}

}  // namespace lightstage::cli
