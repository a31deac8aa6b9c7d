#include "cli/jobs/superres.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <set>

#include <nlohmann/json.hpp>

#include "core/disk_space.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "db/object_room.h"
#include "db/scan_lock.h"

namespace lightstage::cli {

namespace {

constexpr const char* kCamera = "virtual";

db::Scan begin_virtual_scan(db::Store& store, const db::LoadedScan& source, const db::Scan& source_scan,
                            const std::string& provenance, const std::vector<core::Direction>& directions,
                            const std::string& name) {
  if (const auto existing = store.find_scan(name)) {
    if (existing->kind == db::ScanKind::kVirtual && existing->provenance == provenance) return *existing;
    throw made_otherwise(name);
  }
  db::NewScan scan;
  scan.name = name;
  scan.kind = db::ScanKind::kVirtual;
  scan.stage_key = "scan:" + name;
  scan.provenance = provenance;
  scan.cameras = {kCamera};
  db::NewProduct calibration;
  calibration.kind = "calibration";
  calibration.stage_key = scan.stage_key;
  calibration.parameters = provenance;
  std::vector<db::CalibratedLight> lights;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    db::Step step;
    step.step_index = int(i);
    step.light_index = int(i);
    scan.steps.push_back(step);
    db::CalibratedLight light;
    light.light_index = int(i);
    light.light.direction = directions[i];
    lights.push_back(light);
  }
  db::NewProduct mask;
  mask.kind = "mask";
  mask.parameters = "{}";
  mask.input_scans = {source_scan.id};
  mask.images = {{.role = "mask", .index = 0, .object = store.put_object(source.scan.mask())}};
  calibration.input_scans = {source_scan.id};
  // At once: what an interruption leaves is a scan with all that belongs to it but pictures, or nothing.
  store.atomically([&] {
    const db::Id id = store.add_scan(scan);
    calibration.scan_id = mask.scan_id = id;
    store.add_calibration(calibration, lights);
    store.add_product(mask);
  });
  return store.scan(name);
}

}  // namespace

core::UsageError made_otherwise(const std::string& scan) {
  return core::UsageError("a scan '" + scan + "' exists already, made in another way; choose another --out");
}

std::vector<core::Direction> virtual_directions(const std::vector<core::Direction>& lights, std::size_t n) {
  const double reach = 2 * core::median_spacing_radians(lights);
  for (std::size_t tried = n;; tried += std::max<std::size_t>(1, tried / 20)) {
    std::vector<core::Direction> covered;
    for (const core::Direction& direction : core::fibonacci_directions(tried)) {
      const std::size_t nearest = core::nearest_indices(lights, direction, 1).front();
      if (core::angle_radians(lights[nearest], direction) <= reach) covered.push_back(direction);
    }
    if (covered.size() < n) continue;
    // The lattice runs from top to bottom; what is too many is left out evenly.
    std::vector<core::Direction> chosen;
    for (std::size_t i = 0; i < n; ++i) chosen.push_back(covered[i * covered.size() / n]);
    return chosen;
  }
}

SuperresReport superres(db::Store& store, const db::LoadedScan& source, const db::Scan& source_scan,
                        const model::LightInterpolator& interpolator, const std::string& parameters,
                        const std::vector<core::Direction>& directions, const std::string& out) {
  const std::optional<db::Scan> existing = store.find_scan(out);
  const std::size_t there = existing ? store.frames(existing->id).size() : 0;
  std::optional<db::ScanLock> alone;
  if (there < directions.size()) {
    core::require_room(store.folder(), db::most_bytes(source.scan.image_size(), directions.size() - there),
                       "super-resolving '" + out + "'");
    alone.emplace(store.folder(), out, "is being rendered");
  }
  const db::Scan scan = begin_virtual_scan(store, source, source_scan, parameters, directions, out);
  std::set<int> stored;
  for (const db::Frame& frame : store.frames(scan.id)) stored.insert(frame.step_index);
  SuperresReport report{.lights = directions.size(), .already_stored = stored.size()};

  std::optional<core::Progress> progress;
  if (stored.size() < directions.size()) progress.emplace("super-resolving", directions.size() - stored.size());
  double seconds = 0;
  for (const std::size_t i : core::neighbouring_order(directions)) {  // neighbours share captured images
    if (stored.contains(int(i))) continue;
    core::throw_if_interrupted();
    const auto begin = std::chrono::steady_clock::now();
    const core::Image image = interpolator.render(directions[i]);
    seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    db::NewFrame frame;
    frame.scan_id = scan.id;
    frame.camera = kCamera;
    frame.step_index = int(i);
    store.put_frame(frame, image);
    progress->advance();
  }
  if (stored.size() < directions.size()) report.seconds_per_image = seconds / double(directions.size() - stored.size());
  return report;
}

}  // namespace lightstage::cli
