#include "cli/jobs/stage_cameras.h"

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/progress.h"

namespace lightstage::cli {

using nlohmann::ordered_json;

namespace {

core::CameraModel camera_from(const ordered_json& json) {
  core::CameraModel m;
  m.width = json.at("width").get<int>();
  m.height = json.at("height").get<int>();
  const auto numbers = [&](const char* key, std::initializer_list<double*> slots) {
    std::size_t i = 0;
    for (double* slot : slots) *slot = json.at(key).at(i++).get<double>();
  };
  numbers("focal_length_px", {&m.fx, &m.fy});
  numbers("principal_point_px", {&m.cx, &m.cy});
  numbers("radial_distortion", {&m.k1, &m.k2, &m.k3});
  numbers("tangential_distortion", {&m.p1, &m.p2});
  core::RigidTransform& pose = m.stage_from_camera;
  numbers("position_m", {&pose.translation.x, &pose.translation.y, &pose.translation.z});
  core::Vec3 right, down, forward;
  numbers("right", {&right.x, &right.y, &right.z});
  numbers("down", {&down.x, &down.y, &down.z});
  numbers("forward", {&forward.x, &forward.y, &forward.z});
  pose.rotation = core::Mat3{{right, down, forward}}.transposed();
  return m;
}

}  // namespace

ordered_json camera_json(const capture::StageCamera& camera) {
  const core::CameraModel& m = camera.model;
  const core::Mat3 axes = m.stage_from_camera.rotation.transposed();
  const auto list = [](core::Vec3 v) { return ordered_json::array({v.x, v.y, v.z}); };
  return {{"name", camera.name},
          {"width", m.width},
          {"height", m.height},
          {"focal_length_px", {m.fx, m.fy}},
          {"principal_point_px", {m.cx, m.cy}},
          {"radial_distortion", {m.k1, m.k2, m.k3}},
          {"tangential_distortion", {m.p1, m.p2}},
          {"position_m", list(m.centre())},
          {"right", list(axes.rows[0])},
          {"down", list(axes.rows[1])},
          {"forward", list(axes.rows[2])}};
}

CaptureProvenance calibrated_provenance(const db::Store& store, const db::Scan& scan) {
  CaptureProvenance provenance = capture_provenance(scan);
  std::optional<db::Product> newest;
  for (const db::Product& product : store.products("camera_calibration")) {
    if (product.stage_key == scan.stage_key) newest = product;
  }
  if (!newest) return provenance;
  const ordered_json parameters = ordered_json::parse(newest->parameters, nullptr, false);
  for (capture::StageCamera& camera : provenance.stage.cameras) {
    bool found = false;
    try {
      for (const ordered_json& entry : parameters.at("cameras")) {
        if (entry.at("name").get<std::string>() != camera.name) continue;
        found = true;
        const core::CameraModel model = camera_from(entry);
        if (model.width == camera.model.width && model.height == camera.model.height) {
          camera.model = model;
        } else {
          core::warn("scan '" + scan.name + "', camera '" + camera.name +
                     "': calibrated with pictures of another size; taken as drawn");
        }
      }
    } catch (const ordered_json::exception&) {
      throw core::StoreError("camera calibration " + std::to_string(newest->id) +
                             " is damaged: its parameters are not those of cameras");
    }
    if (!found) core::warn("camera '" + camera.name + "' is not in the stage's camera calibration; taken as drawn");
  }
  return provenance;
}

}  // namespace lightstage::cli
