#include "cli/jobs/provenance.h"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "cli/jobs/stored_json.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::cli {

using nlohmann::ordered_json;

std::string to_json(const CaptureProvenance& provenance) {
  ordered_json json{{"stage_toml", capture::to_toml(provenance.stage)},
                    {"sequence_toml", capture::to_toml(provenance.sequence)}};
  if (provenance.pass_steps < provenance.sequence.steps.size()) json["pass_steps"] = provenance.pass_steps;
  if (provenance.simulation) json["simulation"] = ordered_json::parse(sim::to_json(*provenance.simulation));
  if (!provenance.exceeded_limits.empty()) json["i_know"] = provenance.exceeded_limits;
  return json_text(json);
}

bool is_captured(const db::Scan& scan) {
  return scan.kind != db::ScanKind::kImported && scan.kind != db::ScanKind::kVirtual;
}

CaptureProvenance capture_provenance(const db::Scan& scan) {
  if (!is_captured(scan)) {
    throw core::UsageError("scan '" + scan.name + "' is " + std::string(db::to_string(scan.kind)) +
                           ", not captured: it has no stage, cameras or tracking frames");
  }
  const std::string where = "provenance of scan '" + scan.name + "'";
  const ordered_json json = ordered_json::parse(scan.provenance, nullptr, false);
  if (!json.is_object() || !json.contains("stage_toml") || !json.contains("sequence_toml")) {
    throw core::StoreError(where + " is damaged: it names no stage and sequence");
  }
  return reading_json(where, [&] {
    CaptureProvenance provenance;
    provenance.stage = capture::parse_stage(json["stage_toml"].get<std::string>(), where);
    provenance.sequence = capture::parse_sequence(json["sequence_toml"].get<std::string>(), where,
                                                  provenance.stage.light_positions.size());
    provenance.pass_steps = json.value("pass_steps", provenance.sequence.steps.size());
    provenance.exceeded_limits = json.value("i_know", std::vector<std::string>());
    if (json.contains("simulation")) provenance.simulation = sim::simulation_from_json(json["simulation"].dump());
    return provenance;
  });
}

int key_step(const db::Scan& scan) {
  const ordered_json json = ordered_json::parse(scan.provenance, nullptr, false);
  std::vector<db::Step> pass = scan.steps;
  reading_json("provenance of scan '" + scan.name + "'", [&] {
    if (json.is_object()) pass.resize(std::min(pass.size(), json.value("pass_steps", pass.size())));
  });
  return capture::key_step(pass);
}

const capture::StageCamera& camera_of(const capture::Stage& stage, const std::string& name) {
  if (name.empty()) return stage.cameras.front();
  std::vector<std::string> names;
  for (const capture::StageCamera& camera : stage.cameras) {
    if (camera.name == name) return camera;
    names.push_back(camera.name);
  }
  throw core::UsageError("stage '" + stage.name + "' has no camera '" + name + "'" + core::did_you_mean(name, names));
}

}  // namespace lightstage::cli
