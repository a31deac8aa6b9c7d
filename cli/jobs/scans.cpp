#include "cli/jobs/scans.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <nlohmann/json.hpp>

#include "capture/stage.h"
#include "cli/jobs/provenance.h"
#include "cli/jobs/stored_json.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/text.h"
#include "db/content_hash.h"
#include "model/shipped_model.h"

namespace lightstage::cli {

db::LoadedScan load_scan(const db::Store& store, const std::string& name, const std::string& camera) {
  const db::Scan scan = store.scan(name);
  db::LoadOptions options;
  options.camera = camera;
  if (is_captured(scan) && !store.newest_calibration(scan.stage_key)) {
    options.nominal_lights = capture::nominal_lights(capture_provenance(scan).stage);
    core::warn("the stage of '" + name + "' is not calibrated: lights are taken as drawn in its stage file");
  }
  return db::load_scan(store, name, options);
}

std::filesystem::path weights_file(const db::Product& weights) {
  return reading_json("weights " + std::to_string(weights.id),
                      [&] { return nlohmann::json::parse(weights.parameters).value("file", std::string()); });
}

std::optional<std::filesystem::path> file_or_shipped_model(const std::string& file_or_name) {
  if (std::filesystem::is_regular_file(file_or_name)) return file_or_name;
  std::filesystem::path shipped = model::shipped_blend();
  if (!shipped.empty() && file_or_name == shipped.stem()) return shipped;
  return std::nullopt;
}

std::filesystem::path find_model(const db::Store& store, const std::string& file_or_name) {
  if (const auto file = file_or_shipped_model(file_or_name)) return *file;
  const std::vector<db::Product> models = store.products("weights");
  std::vector<std::string> names{model::shipped_blend().stem().string()};
  for (auto model = models.rbegin(); model != models.rend(); ++model) {
    std::filesystem::path file = weights_file(*model);
    names.push_back(file.stem().string());
    if (names.back() != file_or_name) continue;
    if (std::filesystem::is_regular_file(file)) return file;
    throw core::BadInput("model '" + file_or_name + "': its file " + file.string() + " is gone; train it again");
  }
  throw core::UsageError("no model file or model named '" + file_or_name + "'" +
                         core::did_you_mean(file_or_name, names));
}

namespace {

// Why a model that was entered like this is not to be taken; nothing when it may be.
std::optional<std::string> objection(const nlohmann::json& entered, const std::filesystem::path& file,
                                     const model::CheckpointInfo& info, const ModelFilter& filter) {
  const std::string hash = entered.value("hash", std::string());
  if (!hash.empty() && db::hash_file(file).hex() != hash) return "is no longer the file that was trained on this scan";
  if (!filter.better_than_rbf) return std::nullopt;
  const auto provenance = nlohmann::json::parse(info.provenance, nullptr, /*allow_exceptions=*/false);
  const auto error = [&](const char* key) {
    const bool known = provenance.is_object() && provenance.contains(key) && provenance.at(key).is_number();
    return known ? provenance.at(key).get<double>() : std::nan("");
  };
  const double own = error("validation_l1"), rbf = error("rbf_validation_l1");
  if (!(own >= rbf)) return std::nullopt;
  return "was no better than rbf when it was trained (validation error " + core::number_text(own, 3) + ", rbf " +
         core::number_text(rbf, 3) + ")";
}

}  // namespace

std::filesystem::path adapted_models_folder(const db::Store& store) {
  return store.folder() / "models";
}

std::optional<std::filesystem::path> newest_model(const db::Store& store, db::Id scan_id, const ModelFilter& filter) {
  const std::filesystem::path adapted = std::filesystem::weakly_canonical(adapted_models_folder(store));
  const std::vector<db::Product> models = store.products("weights");
  std::set<std::filesystem::path> seen;  // a run that was resumed has entered its file more than once: the last counts
  for (auto model = models.rbegin(); model != models.rend(); ++model) {
    const std::vector<db::Id>& scans = model->input_scans;
    if (std::find(scans.begin(), scans.end(), scan_id) == scans.end()) continue;
    std::filesystem::path file = weights_file(*model);
    if (!seen.insert(file).second || !std::filesystem::is_regular_file(file)) continue;
    if (!filter.adapted && file.parent_path() == adapted) continue;
    std::string problem;
    try {
      const model::CheckpointInfo info = model::read_checkpoint_info(file);
      if (filter.architecture && info.config.architecture != *filter.architecture) continue;
      const auto found = reading_json("weights " + std::to_string(model->id), [&] {
        return objection(nlohmann::json::parse(model->parameters), file, info, filter);
      });
      if (!found) return file;
      problem = file.string() + ": " + *found;
    } catch (const core::Error& error) {
      problem = error.what();
    }
    core::warn(problem + "; it is left out, unless --model names it");
  }
  return std::nullopt;
}

}  // namespace lightstage::cli
