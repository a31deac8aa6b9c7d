// Store: the check of everything.
#include <algorithm>
#include <map>
#include <set>

#include "core/error.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "db/check/misplaced.h"
#include "db/check/thumbnail.h"
#include "db/load/light_image.h"
#include "db/store/impl.h"
#include "db/store/migrations.h"

namespace lightstage::db {
namespace {

std::string step_text(const Scan& scan, const Step& step, const std::string& camera) {
  return "scan '" + scan.name + "', step " + std::to_string(step.step_index) +
         (step.light_index ? " (light " + std::to_string(*step.light_index) + ")" : "") + ", camera '" + camera + "'";
}

std::string counted(std::size_t count, const std::string& singular, const std::string& plural) {
  return std::to_string(count) + " " + (count == 1 ? singular : plural);
}

// The frames of one camera whose pixels are held against the step table.
struct LitFrames {
  std::string place;               // "scan 'x', camera 'c'"
  std::vector<const Step*> steps;  // parallel to the next three
  std::vector<ContentHash> objects;
  std::vector<core::Light> lights;
  std::vector<ContentHash> dark;
  std::optional<ContentHash> mask;
};

class Verification {
 public:
  Verification(const Store& store, SQLite::Database& database, const ObjectFiles& files)
      : store_(store), database_(database), files_(files) {}

  VerifyReport run() {
    try {
      // One view of the catalogue throughout, whatever others write meanwhile.
      SQLite::Transaction snapshot(database_);
      check_catalogue();
      scans_ = store_.scans();
      check_steps();
      for (const Scan& scan : scans_) collect_lit_frames(scan);
      check_objects();
    } catch (const SQLite::Exception& error) {
      report_.errors.push_back(explained(error, store_.folder()).what());
    } catch (const core::StoreError& error) {
      report_.errors.push_back(error.what());
    }
    for (const LitFrames& frames : lit_) check_pixels(frames);
    return std::move(report_);
  }

 private:
  void check_catalogue() {
    SQLite::Statement check(database_, "PRAGMA quick_check");
    while (check.executeStep()) {
      const std::string text = check.getColumn(0).getString();
      if (text != "ok") report_.errors.push_back("catalogue: " + text);
    }
    SQLite::Statement dangling(database_, "PRAGMA foreign_key_check");
    while (dangling.executeStep()) {
      report_.errors.push_back("catalogue: a row of table " + dangling.getColumn(0).getString() + " (" +
                               dangling.getColumn(1).getString() + ") refers to nothing in table " +
                               dangling.getColumn(2).getString());
    }
    SQLite::Database sound(":memory:", SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    migrate(sound);
    if (schema_of(database_) != schema_of(sound)) {
      report_.errors.push_back("catalogue: its tables are not those of schema version " +
                               std::to_string(schema_version()));
    }
  }

  void check_steps() {
    for (const Scan& scan : scans_) {
      for (const std::string& camera : scan.cameras) {
        std::set<int> present;
        for (const Frame& frame : store_.frames(scan.id, camera)) present.insert(frame.step_index);
        report_.frames += present.size();
        if (present.size() == scan.steps.size()) continue;
        const auto first = std::find_if(scan.steps.begin(), scan.steps.end(),
                                        [&](const Step& step) { return !present.contains(step.step_index); });
        std::string remedy =
            "; an interrupted pass goes on with `lightstage capture --resume --name " + scan.name + "`";
        if (scan.kind == ScanKind::kImported) remedy.clear();
        if (scan.kind == ScanKind::kVirtual)
          remedy = "; the `lightstage superres` command that began it goes on with it";
        report_.errors.push_back(step_text(scan, *first, camera) + ": the frame is missing, the first of " +
                                 std::to_string(scan.steps.size() - present.size()) + " that are" + remedy);
      }
    }
  }

  void collect_lit_frames(const Scan& scan) {
    // Virtual scans are computed light by light: nothing can be swapped, and a method may well make several pictures alike.
    if (scan.kind != ScanKind::kOlat && scan.kind != ScanKind::kImported) return;
    const auto calibration = store_.newest_calibration(scan.stage_key);
    if (!calibration) return;
    std::map<int, core::Light> lights;
    for (const CalibratedLight& entry : store_.calibrated_lights(calibration->id)) {
      if (entry.placed) lights.emplace(entry.light_index, entry.light);
    }
    for (const std::string& camera : scan.cameras) {
      LitFrames lit;
      lit.place = "scan '" + scan.name + "', camera '" + camera + "'";
      std::map<int, ContentHash> object_of_step;
      for (const Frame& frame : store_.frames(scan.id, camera)) object_of_step[frame.step_index] = frame.object;
      std::set<int> seen;  // of several exposures the first says enough
      for (const Step& step : scan.steps) {
        const auto object = object_of_step.find(step.step_index);
        if (object == object_of_step.end()) continue;
        if (step.kind == StepKind::kDark) lit.dark.push_back(object->second);
        if (step.kind != StepKind::kLight || !lights.contains(*step.light_index)) continue;
        if (!seen.insert(*step.light_index).second) continue;
        lit.steps.push_back(&step);
        lit.objects.push_back(object->second);
        lit.lights.push_back(lights.at(*step.light_index));
      }
      if (const auto mask = store_.newest_product("mask", scan, camera)) {
        for (const ProductImage& image : mask->images) {
          if (image.role == "mask") lit.mask = image.object;
        }
      }
      for (const ContentHash& hash : lit.objects) thumbnails_[hash];
      for (const ContentHash& hash : lit.dark) thumbnails_[hash];
      if (lit.mask) thumbnails_[*lit.mask];
      lit_.push_back(std::move(lit));
    }
  }

  // What refers to each object; objects known to the catalogue that nothing refers to have no owner.
  std::map<ContentHash, std::string> owners() const {
    std::map<ContentHash, std::string> owners;
    SQLite::Statement row(database_,
                          "SELECT f.object, 'scan ''' || s.name || ''', step ' || f.step_index || ', camera "
                          "''' || f.camera || '''' "
                          "FROM frames f JOIN scans s ON s.id = f.scan_id "
                          "UNION ALL SELECT i.object, p.kind || ' ' || CASE p.name WHEN '' THEN '' ELSE '''' "
                          "|| p.name || ''' ' END || "
                          "'(product ' || p.id || '), image ''' || i.role || ''' ' || i.image_index "
                          "FROM product_images i JOIN products p ON p.id = i.product_id");
    while (row.executeStep())
      owners.emplace(ContentHash::from_hex(row.getColumn(0).getString()), row.getColumn(1).getString());
    return owners;
  }

  void check_objects() {
    const std::map<ContentHash, std::string> owner = owners();
    const ObjectFiles::Listing listing = files_.list();
    std::set<ContentHash> all(listing.objects.begin(), listing.objects.end());
    for (const auto& [hash, text] : owner) all.insert(hash);
    const std::vector<ContentHash> hashes(all.begin(), all.end());
    report_.objects = hashes.size();

    std::vector<std::optional<std::string>> problems(hashes.size());
    core::Progress progress("verify", hashes.size());
    core::parallel_for(hashes.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        core::throw_if_interrupted();
        problems[i] = check_object(hashes[i]);
        progress.advance();
      }
    });
    std::size_t orphans = 0;
    for (std::size_t i = 0; i < hashes.size(); ++i) {
      const auto owned = owner.find(hashes[i]);
      if (owned == owner.end()) ++orphans;
      if (!problems[i]) continue;
      report_.errors.push_back((owned == owner.end() ? std::string() : owned->second + ": ") + "object " +
                               hashes[i].hex() + " " + *problems[i]);
    }
    if (orphans > 0) {
      report_.notes.push_back(counted(orphans, "object belongs", "objects belong") +
                              " to no frame or product (left by a crash or a removed scan; harmless)");
    }
    for (const auto& stranger : listing.strangers) {
      report_.notes.push_back(stranger.string() + ": is no object (an interrupted write leaves such files; harmless)");
    }
  }

  // Also takes the thumbnail, where one is wanted: an object is decoded while its bytes are still in the page
  // cache.
  std::optional<std::string> check_object(const ContentHash& hash) {
    if (auto problem = files_.problem(hash)) return problem;
    const auto wanted = thumbnails_.find(hash);
    if (wanted == thumbnails_.end()) return std::nullopt;
    try {
      wanted->second = shrink(core::read_image(files_.path(hash)), kShapeSide);
    } catch (const core::BadInput& error) {
      return std::string("is not an image: ") + error.what();
    }
    return std::nullopt;
  }

  // The subject lit by one light, as find_misplaced wants it; empty when an object is missing or damaged.
  core::Image lit_thumbnail(const LitFrames& frames, std::size_t at, const core::Image& dark) const {
    core::Image image = thumbnails_.at(frames.objects[at]);
    if (image.empty()) return {};
    subtract_dark(image, dark);
    divide_by_gain(image, frames.lights[at].gain);
    return core::to_luminance(image);
  }

  void check_pixels(const LitFrames& frames) {
    core::Image dark;
    std::vector<core::ImageView> dark_views;
    for (const ContentHash& hash : frames.dark) {
      if (!thumbnails_.at(hash).empty()) dark_views.push_back(thumbnails_.at(hash));
    }
    if (!dark_views.empty()) {
      dark = core::weighted_sum(dark_views, std::vector<double>(dark_views.size(), 1.0 / double(dark_views.size())));
    }
    std::vector<core::Direction> directions;
    std::vector<core::Image> thumbnails;
    std::vector<const Step*> steps;
    for (std::size_t i = 0; i < frames.objects.size(); ++i) {
      core::Image thumbnail = lit_thumbnail(frames, i, dark);
      if (thumbnail.empty()) continue;
      directions.push_back(frames.lights[i].direction);
      thumbnails.push_back(std::move(thumbnail));
      steps.push_back(frames.steps[i]);
    }
    core::Image mask;
    if (frames.mask && !thumbnails_.at(*frames.mask).empty()) mask = core::to_luminance(thumbnails_.at(*frames.mask));
    if (!mask.empty() && !thumbnails.empty() && mask.size() != thumbnails.front().size()) {
      report_.errors.push_back(frames.place + ": the mask is not of the size of the frames");
      mask = core::Image();
    }
    const auto label = [](const Step& step) {
      return "step " + std::to_string(step.step_index) + " (light " + std::to_string(*step.light_index) + ")";
    };
    for (const Misplaced& found : find_misplaced(directions, thumbnails, mask)) {
      const std::string other = label(*steps[found.resembles]);
      report_.errors.push_back(
          frames.place + ", " + label(*steps[found.index]) +
          (found.swapped ? ": the frame seems swapped with that of " + other
                         : ": the frame does not fit those of the lights around; it resembles those around " + other));
    }
  }

  const Store& store_;
  SQLite::Database& database_;
  const ObjectFiles& files_;
  VerifyReport report_;
  std::vector<Scan> scans_;
  std::vector<LitFrames> lit_;                     // point into scans_
  std::map<ContentHash, core::Image> thumbnails_;  // wanted ones; linear, empty until read
};

}  // namespace

VerifyReport Store::verify() const {
  return Verification(*this, impl_->database, impl_->objects).run();
}

}  // namespace lightstage::db
