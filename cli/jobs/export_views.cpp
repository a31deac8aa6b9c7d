#include "cli/jobs/export_views.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "capture/sequence.h"
#include "cli/jobs/stage_cameras.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/text.h"
#include "core/undistortion.h"
#include "core/unfinished_folder.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

using core::CameraModel;
using core::Mat3;
using core::Vec3;

constexpr int kDigits = 17;  // every double reads back

std::string numbers(std::initializer_list<double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : " ") + core::number_text(value, kDigits);
  return text;
}

bool distorted(const CameraModel& m) {
  return m.k1 != 0 || m.k2 != 0 || m.k3 != 0 || m.p1 != 0 || m.p2 != 0;
}

// w, x, y, z with w >= 0 (Shepperd 1978, "Quaternion from rotation matrix": the largest component first).
std::array<double, 4> quaternion(const Mat3& m) {
  const double xx = m.rows[0].x, yy = m.rows[1].y, zz = m.rows[2].z;
  const std::array<double, 4> squares{xx + yy + zz, xx - yy - zz, yy - xx - zz, zz - xx - yy};
  const std::size_t largest = std::size_t(std::max_element(squares.begin(), squares.end()) - squares.begin());
  const double root = std::sqrt(1 + squares[largest]) / 2, part = 1 / (4 * root);
  const double wx = (m.rows[2].y - m.rows[1].z) * part, wy = (m.rows[0].z - m.rows[2].x) * part,
               wz = (m.rows[1].x - m.rows[0].y) * part;
  const double xy = (m.rows[1].x + m.rows[0].y) * part, xz = (m.rows[2].x + m.rows[0].z) * part,
               yz = (m.rows[2].y + m.rows[1].z) * part;
  std::array<double, 4> q{};
  if (largest == 0) q = {root, wx, wy, wz};
  if (largest == 1) q = {wx, root, xy, xz};
  if (largest == 2) q = {wy, xy, root, yz};
  if (largest == 3) q = {wz, xz, yz, root};
  if (q[0] < 0) q = {-q[0], -q[1], -q[2], -q[3]};
  return q;
}

void write_colmap(const std::filesystem::path& folder, const std::vector<capture::StageCamera>& cameras) {
  std::string camera_text = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  std::string image_text =
      "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID): none\n";
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const CameraModel& m = cameras[c].model;
    const std::string id = std::to_string(c + 1);
    const double cx = m.cx + 0.5, cy = m.cy + 0.5;
    std::string model = "PINHOLE", parameters = numbers({m.fx, m.fy, cx, cy});
    if (distorted(m)) {
      model = "OPENCV";
      parameters += " " + numbers({m.k1, m.k2, m.p1, m.p2});
      if (m.k3 != 0) {
        model = "FULL_OPENCV";
        parameters += " " + numbers({m.k3, 0, 0, 0});
      }
    }
    camera_text +=
        id + " " + model + " " + std::to_string(m.width) + " " + std::to_string(m.height) + " " + parameters + "\n";
    const core::RigidTransform camera_from_world = m.stage_from_camera.inverse();
    const std::array<double, 4> q = quaternion(camera_from_world.rotation);
    const Vec3 t = camera_from_world.translation;
    image_text +=
        id + " " + numbers({q[0], q[1], q[2], q[3], t.x, t.y, t.z}) + " " + id + " " + cameras[c].name + ".png\n\n";
  }
  core::make_folder(folder / "sparse");
  core::write_file_atomically(folder / "sparse" / "cameras.txt", camera_text);
  core::write_file_atomically(folder / "sparse" / "images.txt", image_text);
  core::write_file_atomically(folder / "sparse" / "points3D.txt",
                              "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX): none\n");
}

void write_transforms(const std::filesystem::path& folder, const std::vector<capture::StageCamera>& cameras,
                      bool masks) {
  nlohmann::ordered_json frames = nlohmann::ordered_json::array();
  for (const capture::StageCamera& camera : cameras) {
    const CameraModel& m = camera.model;
    nlohmann::ordered_json matrix = nlohmann::ordered_json::array();
    const Mat3& r = m.stage_from_camera.rotation;
    const Vec3 t = m.centre();
    const std::array<double, 3> shift{t.x, t.y, t.z};
    for (std::size_t row = 0; row < 3; ++row)
      matrix.push_back({r.rows[row].x, -r.rows[row].y, -r.rows[row].z, shift[row]});
    matrix.push_back({0, 0, 0, 1});
    nlohmann::ordered_json frame{{"file_path", "images/" + camera.name + ".png"}};
    if (masks) frame["mask_path"] = "masks/" + camera.name + ".png";
    frame.update({{"w", m.width},
                  {"h", m.height},
                  {"fl_x", m.fx},
                  {"fl_y", m.fy},
                  {"cx", m.cx + 0.5},
                  {"cy", m.cy + 0.5},
                  {"k1", m.k1},
                  {"k2", m.k2},
                  {"k3", m.k3},
                  {"p1", m.p1},
                  {"p2", m.p2},
                  {"transform_matrix", matrix}});
    frames.push_back(frame);
  }
  core::write_file_atomically(folder / "transforms.json",
                              json_text({{"camera_model", "OPENCV"}, {"aabb_scale", 1}, {"frames", frames}}) + "\n");
}

int step_to_show(const db::Scan& scan, const std::optional<int>& light_index) {
  if (!light_index) {
    const int key = capture::key_step(scan.steps);
    if (key >= 0) return key;
    throw core::UsageError("scan '" + scan.name + "' has no frame under all lights; choose one by --light INDEX");
  }
  for (const db::Step& step : scan.steps) {
    if (step.kind == db::StepKind::kLight && step.light_index == light_index) return step.step_index;
  }
  throw core::UsageError("scan '" + scan.name + "' has no frame under light " + std::to_string(*light_index));
}

}  // namespace

void export_views(const db::Store& store, const std::string& name, const std::filesystem::path& folder,
                  const ExportViewsOptions& options) {
  const db::Scan scan = store.scan(name);
  std::vector<capture::StageCamera> cameras = calibrated_provenance(store, scan).stage.cameras;
  const int step = step_to_show(scan, options.light_index);
  core::UnfinishedFolder unfinished(folder);
  std::vector<core::Image> images;
  double bright = 0;
  for (const capture::StageCamera& camera : cameras) {
    core::throw_if_interrupted();
    const std::vector<db::Frame> frames = store.frames(scan.id, camera.name);
    const auto frame =
        std::find_if(frames.begin(), frames.end(), [&](const db::Frame& f) { return f.step_index == step; });
    if (frame == frames.end()) {
      throw core::StoreError("scan '" + name + "', camera '" + camera.name + "': step " + std::to_string(step) +
                             " is missing; run `lightstage capture --resume --name " + name + "`");
    }
    images.push_back(core::to_rgb(db::load_frame(store, *frame, db::dark_level(store, scan, camera.name),
                                                 db::flat_field(store, scan, camera.name).image)));
    bright = std::max(bright, core::quantile(images.back().values(), 0.995));
  }
  const float scale = bright > 0 ? float(1 / bright) : 1;
  core::make_folder(unfinished.path() / "images");
  if (options.undistort) core::make_folder(unfinished.path() / "masks");
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    core::throw_if_interrupted();
    for (float& value : images[c].values()) value *= scale;
    const std::string file = cameras[c].name + ".png";
    if (options.undistort) {
      core::Undistorted seen = core::undistort(images[c], cameras[c].model);
      const bool colmap = options.format == ViewFormat::kColmap;
      core::write_image(unfinished.path() / "masks" / (colmap ? file + ".png" : file), seen.mask);
      images[c] = std::move(seen.picture);
      cameras[c].model = core::pinhole_of(cameras[c].model);
    }
    core::write_image(unfinished.path() / "images" / file, images[c]);
  }
  if (options.format == ViewFormat::kColmap) {
    write_colmap(unfinished.path(), cameras);
  } else {
    write_transforms(unfinished.path(), cameras, options.undistort);
  }
  unfinished.finish();
}

}  // namespace lightstage::cli
