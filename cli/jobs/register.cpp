#include "cli/jobs/register.h"

#include <algorithm>
#include <map>

#include <nlohmann/json.hpp>

#include "align/registration.h"
#include "capture/stage.h"
#include "cli/jobs/provenance.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

core::Image ones(core::ImageSize size) {
  core::Image image(size.height, size.width, 1);
  std::fill(image.values().begin(), image.values().end(), 1.0F);
  return image;
}

double median_of(std::vector<float> values) {
  return values.empty() ? 0 : core::quantile(values, 0.5);
}

void register_camera(db::Store& store, const db::Scan& scan, const std::string& camera, db::NewProduct& product,
                     RegisterReport& report) {
  db::LoadOptions load{.camera = camera, .use_alignment = false, .nominal_lights = {}};
  if (is_captured(scan) && !store.newest_calibration(scan.stage_key)) {
    load.nominal_lights = capture::nominal_lights(capture_provenance(scan).stage);
  }
  const db::LoadedScan loaded = db::load_scan(store, scan.name, load);
  std::vector<core::Direction> lights;
  std::map<int, std::size_t> place_of_light;
  for (std::size_t i = 0; i < loaded.scan.light_count(); ++i) {
    lights.push_back(loaded.scan.light(i).direction);
    place_of_light.emplace(loaded.light_index[i], i);
  }
  if (lights.size() < 3) {
    throw core::UsageError("scan '" + scan.name + "' has too few lights to be registered: 3 at least");
  }
  core::note("registering " + std::to_string(lights.size()) + " pictures with each other, " + camera);
  const std::vector<align::Registered> found =
      align::register_pictures([&](std::size_t i) { return core::Image(*loaded.scan.image(i)); }, lights);

  std::vector<float> motions, before, after;
  std::size_t objected = 0;
  for (const align::Registered& picture : found) {
    objected += !picture.objection.empty();
    if (!picture.objection.empty()) continue;
    motions.push_back(float(std::hypot(picture.motion.dx, picture.motion.dy)));
    before.push_back(float(picture.residual_before_px));
    after.push_back(float(picture.residual_after_px));
  }
  if (2 * objected > found.size()) {
    throw core::BadInput("scan '" + scan.name + "', camera '" + camera + "': " + std::to_string(objected) + " of " +
                         std::to_string(found.size()) +
                         " pictures cannot be registered with those of the lights beside theirs; are they of one still "
                         "subject, and the lights' directions right?");
  }
  report.median_motion_px = std::max(report.median_motion_px, median_of(motions));
  report.largest_motion_px =
      std::max(report.largest_motion_px, double(*std::max_element(motions.begin(), motions.end())));
  report.residual_before_px = std::max(report.residual_before_px, median_of(before));
  report.residual_after_px = std::max(report.residual_after_px, median_of(after));

  const core::Image dark = db::dark_level(store, scan, camera);
  const db::FlatField flat = db::flat_field(store, scan, camera);
  if (flat.id) product.input_products.push_back(*flat.id);
  core::Image seen;  // 1 where every frame that is used shows something
  for (const db::Frame& frame : store.frames(scan.id, camera)) {
    core::throw_if_interrupted();
    const db::Step& step = db::step_of(scan, frame.step_index);
    if (step.kind != db::StepKind::kLight) continue;
    const auto place = place_of_light.find(*step.light_index);
    const std::string objection =
        place == place_of_light.end() ? "its light has no direction" : found[place->second].objection;
    core::Image picture = db::load_frame(store, frame, dark, flat.image);
    double residual = 0;
    if (objection.empty()) {
      const align::Registered& registered = found[place->second];
      const align::FlowField flow = registered.motion.flow(picture.height(), picture.width());
      picture = align::warp(picture, flow);
      core::Image confidence = ones(picture.size());
      align::clear_outside(confidence, flow);
      if (seen.empty()) seen = confidence;
      align::clear_outside(seen, flow);
      product.images.push_back({.role = "confidence",
                                .index = frame.step_index,
                                .object = store.put_object(confidence),
                                .value = registered.residual_after_px});
      residual = registered.residual_after_px;
      ++report.aligned;
    } else {
      report.excluded.push_back({camera, frame.step_index, step.light_index, objection});
    }
    product.images.push_back({.role = objection.empty() ? "aligned" : "excluded",
                              .index = frame.step_index,
                              .object = store.put_object(picture),
                              .value = residual});
  }
  if (!seen.empty()) product.images.push_back({.role = "seen", .index = 0, .object = store.put_object(seen)});
}

}  // namespace

RegisterReport register_scan(db::Store& store, const db::Scan& scan) {
  require_room_for_alignment(store, scan);
  RegisterReport report;
  std::vector<db::NewProduct> products;
  for (const std::string& camera : scan.cameras) {
    db::NewProduct product;
    product.kind = "alignment";
    product.scan_id = scan.id;
    product.input_scans = {scan.id};
    const std::size_t excluded_before = report.excluded.size();
    register_camera(store, scan, camera, product, report);
    nlohmann::ordered_json excluded = nlohmann::ordered_json::array();
    for (std::size_t i = excluded_before; i < report.excluded.size(); ++i) {
      excluded.push_back({{"step", report.excluded[i].step_index}, {"reason", report.excluded[i].reason}});
    }
    product.parameters = json_text({{"camera", camera}, {"registration", "local contrast"}, {"excluded", excluded}});
    products.push_back(std::move(product));
  }
  // All cameras or none: what ends the program before leaves the scan as it was.
  store.atomically([&] {
    for (const db::NewProduct& product : products) store.add_product(product);
  });
  return report;
}

}  // namespace lightstage::cli
