#include "hil/scenarios/report_line.h"

#include <cstdio>
#include <fstream>

#include "hil/scenarios/emulated_rig.h"

namespace lightstage::hil {

ReportLine::ReportLine(std::string scenario) : scenario_(std::move(scenario)), start_(clock_.now()) {}

ReportLine::~ReportLine() {
  const double seconds = static_cast<double>(clock_.now() - start_) / 1e9;
  std::printf("%-20s %s faults %2zu  frames %3zu  retaken %2zu  wrong %zu  lights left on %zu  %5.1f s",
              scenario_.c_str(), passed_ ? "ok    " : "FAILED", faults_, frames_, retaken_, wrong_, lights_left_on_,
              seconds);
  for (const auto& [name, value] : figures_.items()) std::printf("  %s %.1f", name.c_str(), value.get<double>());
  std::printf("\n");
  std::fflush(stdout);
  std::ofstream summary(output_folder() / "summary.jsonl", std::ios::app);
  summary << nlohmann::json{{"scenario", scenario_},
                            {"passed", passed_},
                            {"faults", faults_},
                            {"frames_asked", frames_},
                            {"retaken", retaken_},
                            {"wrong", wrong_},
                            {"lights_left_on", lights_left_on_},
                            {"seconds", seconds},
                            {"figures", figures_}}
                 .dump()
          << '\n';
}

}  // namespace lightstage::hil
