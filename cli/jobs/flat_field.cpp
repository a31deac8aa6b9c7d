#include "cli/jobs/flat_field.h"

#include <algorithm>
#include <map>

#include <nlohmann/json.hpp>

#include "cli/jobs/provenance.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

using core::Vec3;

constexpr double kLeastCosine = 0.5;

// Whether so much of a picture clips that what is left says little of the lens.
bool overexposed(core::ImageView picture, double saturation) {
  constexpr double kBright = 0.95, kShare = 0.02;
  if (!(saturation > 0)) return false;
  std::size_t bright = 0;
  for (int y = 0; y < picture.height(); ++y) {
    const float* row = picture.row(y);
    bright += std::size_t(std::count_if(row, row + picture.width() * picture.channels(),
                                        [&](float v) { return double(v) >= kBright * saturation; }));
  }
  return double(bright) > kShare * double(picture.size().value_count());
}

std::map<int, Vec3> light_positions(const db::Store& store, const db::Scan& scan, const capture::Stage& stage) {
  std::map<int, Vec3> positions;
  if (const auto calibration = store.newest_calibration(scan.stage_key)) {
    for (const db::CalibratedLight& entry : store.calibrated_lights(calibration->id)) {
      if (!entry.placed) continue;
      positions[entry.light_index] = entry.light.position.value_or(entry.light.direction.vec() * stage.radius_m);
    }
    return positions;
  }
  core::warn("scan '" + scan.name + "': the stage's lights are not calibrated, and taken to hang where they are drawn");
  for (std::size_t i = 0; i < stage.light_positions.size(); ++i) positions[int(i)] = stage.light_positions[i];
  return positions;
}

// Irradiance of the plane through stage centre, to a factor, where a camera's pixel sees it.
std::function<double(double, double)> card_light(const core::CameraModel& camera, Vec3 normal, Vec3 light) {
  return [camera, normal, light](double x, double y) {
    const Vec3 ray = camera.ray({x, y}), from = camera.centre();
    const double towards = dot(normal, ray);
    if (!(towards < 0)) return 0.0;
    const Vec3 point = from - ray * (dot(normal, from) / towards);
    const Vec3 to_light = light - point;
    const double distance = norm(to_light);
    return std::max(0.0, dot(normal, to_light)) / (distance * distance * distance);
  };
}

}  // namespace

calib::FlatField flat_from_pass(const db::Store& store, const db::Scan& scan, const std::string& camera,
                                const calib::FlatOptions& options) {
  const CaptureProvenance provenance = capture_provenance(scan);
  const capture::StageCamera& seen_by = camera_of(provenance.stage, camera);
  const std::map<int, Vec3> positions = light_positions(store, scan, provenance.stage);
  const Vec3 primary = provenance.stage.cameras.front().model.centre();
  const Vec3 normal = primary / norm(primary);
  const core::Image dark = db::dark_level(store, scan, camera);
  std::vector<core::Image> images;
  std::vector<calib::FlatPicture> pictures;
  std::size_t lit = 0;
  const std::vector<db::Frame> frames = store.frames(scan.id, camera);
  core::Progress progress("flat field, " + camera, frames.size());
  for (const db::Frame& frame : frames) {
    core::throw_if_interrupted();
    progress.advance();
    const db::Step& step = db::step_of(scan, frame.step_index);
    const auto light = step.kind == db::StepKind::kLight ? positions.find(*step.light_index) : positions.end();
    if (light == positions.end() || dot(normal, light->second) < kLeastCosine * norm(light->second)) continue;
    core::Image image = db::load_frame(store, frame, dark);
    ++lit;
    if (overexposed(image, frame.saturation)) continue;
    images.push_back(std::move(image));
    pictures.push_back({{}, frame.saturation, card_light(seen_by.model, normal, light->second)});
  }
  const std::string where = "scan '" + scan.name + "', camera '" + camera + "': ";
  if (images.empty() && lit > 0) {
    throw core::BadInput(where + "the card is overexposed in all " + std::to_string(lit) +
                         " frames; capture it with a shorter --exposure");
  }
  if (images.empty()) throw core::BadInput(where + "no frame is lit by a light within 60 degrees of the card's normal");
  for (std::size_t i = 0; i < images.size(); ++i) pictures[i].picture = images[i];
  try {
    return calib::fit_flat_field(pictures, options);
  } catch (const core::BadInput& error) {
    throw core::BadInput(where + error.what());
  }
}

void store_flat_field(db::Store& store, const db::Scan& scan, const std::string& camera, const calib::FlatField& field,
                      bool of_scan) {
  db::NewProduct product;
  product.kind = "flat_field";
  product.stage_key = scan.stage_key;
  product.parameters = json_text({{"camera", camera},
                                  {"corner", field.corner},
                                  {"sigma", field.sigma},
                                  {"residual", field.residual},
                                  {"condition", field.condition}});
  if (of_scan) product.input_scans = {scan.id};
  product.images = {{.role = "flat", .index = 0, .object = store.put_object(field.flat), .value = field.sigma}};
  store.add_product(product);
}

}  // namespace lightstage::cli
