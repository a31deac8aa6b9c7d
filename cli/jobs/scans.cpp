#include "cli/jobs/scans.h"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "capture/stage.h"
#include "cli/jobs/provenance.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/text.h"
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

namespace {

std::filesystem::path file_of(const db::Product& model) {
  return nlohmann::json::parse(model.parameters).value("file", std::string());
}

}  // namespace

std::optional<std::filesystem::path> file_or_shipped_model(const std::string& file_or_name) {
  if (std::filesystem::is_regular_file(file_or_name)) return file_or_name;
  const std::filesystem::path shipped = model::shipped_blend();
  if (!shipped.empty() && file_or_name == shipped.stem()) return shipped;
  return std::nullopt;
}

std::filesystem::path find_model(const db::Store& store, const std::string& file_or_name) {
  if (const auto file = file_or_shipped_model(file_or_name)) return *file;
  const std::vector<db::Product> models = store.products("weights");
  std::vector<std::string> names{model::shipped_blend().stem().string()};
  for (auto model = models.rbegin(); model != models.rend(); ++model) {
    const std::filesystem::path file = file_of(*model);
    names.push_back(file.stem().string());
    if (names.back() != file_or_name) continue;
    if (std::filesystem::is_regular_file(file)) return file;
    throw core::BadInput("model '" + file_or_name + "': its file " + file.string() + " is gone; train it again");
  }
  throw core::UsageError("no model file or model named '" + file_or_name + "'" +
                         core::did_you_mean(file_or_name, names));
}

std::optional<std::filesystem::path> newest_model(const db::Store& store, db::Id scan_id,
                                                  std::optional<model::Architecture> architecture) {
  const std::vector<db::Product> models = store.products("weights");
  for (auto model = models.rbegin(); model != models.rend(); ++model) {
    const std::vector<db::Id>& scans = model->input_scans;
    if (std::find(scans.begin(), scans.end(), scan_id) == scans.end()) continue;
    const std::filesystem::path file = file_of(*model);
    if (!std::filesystem::is_regular_file(file)) continue;
    try {
      const model::Architecture found = model::read_checkpoint_info(file).config.architecture;
      if (!architecture || found == *architecture) return file;
    } catch (const core::BadInput& error) {
      core::warn(std::string(error.what()) + "; it is left out");
    }
  }
  return std::nullopt;
}

}  // namespace lightstage::cli
