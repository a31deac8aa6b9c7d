#include "db/store/scan_contents.h"

#include <set>

#include <SQLiteCpp/Statement.h>

#include "db/check/misplaced.h"
#include "db/load/light_image.h"

namespace lightstage::db {

namespace {

constexpr const char* kProductImages =
    "SELECT i.object, p.kind || ' ' || CASE p.name WHEN '' THEN '' ELSE '''' || p.name || ''' ' END || "
    "'(product ' || p.id || '), image ''' || i.role || ''' ' || i.image_index "
    "FROM product_images i JOIN products p ON p.id = i.product_id ";

void append(std::vector<OwnedObject>& objects, SQLite::Statement row) {
  while (row.executeStep()) {
    objects.push_back({ContentHash::from_hex(row.getColumn(0).getString()), row.getColumn(1).getString()});
  }
}

SQLite::Statement about(SQLite::Database& database, const std::string& sql, Id scan_id) {
  SQLite::Statement statement(database, sql);
  statement.bind(1, scan_id);
  return statement;
}

std::string label(const Step& step) {
  return "step " + std::to_string(step.step_index) + " (light " + std::to_string(*step.light_index) + ")";
}

// The subject lit by one light, as find_misplaced wants it; empty when an object is missing or damaged.
core::Image lit_thumbnail(const core::Image& stored, const core::Image& dark, const core::Light& light) {
  if (stored.empty()) return {};
  core::Image image = stored;
  subtract_dark(image, dark);
  divide_by_gain(image, light.gain);
  return core::to_luminance(image);
}

}  // namespace

std::vector<OwnedObject> objects_of_scan(SQLite::Database& database, Id scan_id) {
  std::vector<OwnedObject> objects;
  append(objects, about(database,
                        "SELECT f.object, 'scan ''' || s.name || ''', step ' || f.step_index || ', camera ''' || "
                        "f.camera || '''' FROM frames f JOIN scans s ON s.id = f.scan_id WHERE f.scan_id = ? "
                        "ORDER BY f.step_index, f.camera",
                        scan_id));
  append(objects, about(database, std::string(kProductImages) + "WHERE p.scan_id = ? ORDER BY p.id", scan_id));
  return objects;
}

std::vector<OwnedObject> objects_of_no_scan(SQLite::Database& database) {
  std::vector<OwnedObject> objects;
  append(objects, SQLite::Statement(database, std::string(kProductImages) + "WHERE p.scan_id IS NULL ORDER BY p.id"));
  return objects;
}

bool is_referred_to(SQLite::Database& database, const ContentHash& hash) {
  SQLite::Statement row(database,
                        "SELECT 1 FROM frames WHERE object = ?1 UNION ALL SELECT 1 FROM product_images WHERE object "
                        "= ?1 LIMIT 1");
  row.bind(1, hash.hex());
  return row.executeStep();
}

std::vector<LitFrames> lit_frames(const Store& store, const Scan& scan) {
  // Virtual scans are computed light by light: nothing can be swapped, and a method may well make several pictures alike.
  if (scan.kind != ScanKind::kOlat && scan.kind != ScanKind::kImported) return {};
  const auto calibration = store.newest_calibration(scan.stage_key);
  if (!calibration) return {};
  std::map<int, core::Light> lights;
  for (const CalibratedLight& entry : store.calibrated_lights(calibration->id)) {
    if (entry.placed) lights.emplace(entry.light_index, entry.light);
  }
  std::vector<LitFrames> all;
  for (const std::string& camera : scan.cameras) {
    LitFrames lit;
    lit.place = "scan '" + scan.name + "', camera '" + camera + "'";
    std::map<int, ContentHash> object_of_step;
    for (const Frame& frame : store.frames(scan.id, camera)) object_of_step[frame.step_index] = frame.object;
    std::set<int> seen;  // of several exposures the first says enough
    for (const Step& step : scan.steps) {
      const auto object = object_of_step.find(step.step_index);
      if (object == object_of_step.end()) continue;
      if (step.kind == StepKind::kDark) lit.dark.push_back(object->second);
      if (step.kind != StepKind::kLight || !lights.contains(*step.light_index)) continue;
      if (!seen.insert(*step.light_index).second) continue;
      lit.labels.push_back(label(step));
      lit.objects.push_back(object->second);
      lit.lights.push_back(lights.at(*step.light_index));
    }
    if (const auto mask = store.newest_product("mask", scan, camera)) {
      for (const ProductImage& image : mask->images) {
        if (image.role == "mask") lit.mask = image.object;
      }
    }
    all.push_back(std::move(lit));
  }
  return all;
}

std::vector<std::string> misplaced_frames(const LitFrames& frames, const Thumbnails& thumbnails) {
  std::vector<std::string> errors;
  core::Image dark;
  std::vector<core::ImageView> dark_views;
  for (const ContentHash& hash : frames.dark) {
    if (!thumbnails.at(hash).empty()) dark_views.push_back(thumbnails.at(hash));
  }
  if (!dark_views.empty()) {
    dark = core::weighted_sum(dark_views, std::vector<double>(dark_views.size(), 1.0 / double(dark_views.size())));
  }
  std::vector<core::Direction> directions;
  std::vector<core::Image> pictures;
  std::vector<std::string> labels;
  for (std::size_t i = 0; i < frames.objects.size(); ++i) {
    core::Image picture = lit_thumbnail(thumbnails.at(frames.objects[i]), dark, frames.lights[i]);
    if (picture.empty()) continue;
    directions.push_back(frames.lights[i].direction);
    pictures.push_back(std::move(picture));
    labels.push_back(frames.labels[i]);
  }
  core::Image mask;
  if (frames.mask && !thumbnails.at(*frames.mask).empty()) mask = core::to_luminance(thumbnails.at(*frames.mask));
  if (!mask.empty() && !pictures.empty() && mask.size() != pictures.front().size()) {
    errors.push_back(frames.place + ": the mask is not of the size of the frames");
    mask = core::Image();
  }
  for (const Misplaced& found : find_misplaced(directions, pictures, mask)) {
    const std::string& other = labels[found.resembles];
    errors.push_back(frames.place + ", " + labels[found.index] +
                     (found.swapped
                          ? ": the frame seems swapped with that of " + other
                          : ": the frame does not fit those of the lights around; it resembles those around " + other));
  }
  return errors;
}

}  // namespace lightstage::db
