#include "cli/jobs/scans.h"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "capture/stage.h"
#include "cli/jobs/provenance.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/text.h"

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

std::optional<std::filesystem::path> find_model(const db::Store& store, const std::string& file_or_name,
                                                db::Id scan_id) {
  if (std::filesystem::is_regular_file(file_or_name)) return file_or_name;
  const std::vector<db::Product> models = store.products("weights");
  std::vector<std::string> names;
  for (auto model = models.rbegin(); model != models.rend(); ++model) {
    const std::filesystem::path file = nlohmann::json::parse(model->parameters).value("file", std::string());
    names.push_back(file.stem().string());
    const bool wanted = file_or_name.empty() ? std::find(model->input_scans.begin(), model->input_scans.end(),
                                                         scan_id) != model->input_scans.end()
                                             : names.back() == file_or_name;
    if (!wanted) continue;
    if (std::filesystem::is_regular_file(file)) return file;
    if (!file_or_name.empty()) {
      throw core::BadInput("model '" + file_or_name + "': its file " + file.string() + " is gone; train it again");
    }
  }
  if (file_or_name.empty()) return std::nullopt;
  throw core::UsageError("no model file or model named '" + file_or_name + "'" +
                         core::did_you_mean(file_or_name, names));
}

}  // namespace lightstage::cli
