// Store: the check of everything.
#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <sstream>

#include "core/error.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/text.h"
#include "db/check/thumbnail.h"
#include "db/store/impl.h"
#include "db/store/migrations.h"
#include "db/store/page_checks.h"
#include "db/store/scan_contents.h"
#include "db/store/verify_state.h"

namespace lightstage::db {
namespace {

class Verification {
 public:
  Verification(const Store& store, SQLite::Database& database, const ObjectFiles& files)
      : store_(store), database_(database), files_(files) {}

  VerifyReport everything(bool resume) {
    explaining_errors([&] { check_catalogue(); });
    std::vector<Id> ids;
    explaining_errors([&] {
      SQLite::Statement row(database_, "SELECT id FROM scans ORDER BY id");
      while (row.executeStep()) ids.push_back(row.getColumn(0).getInt64());
      state_.store_id = database_.execAndGet("SELECT store_id FROM identity").getString();
    });
    if (resume) take_up(ids);
    explaining_errors([&] {
      const auto known = std::size_t(database_.execAndGet("SELECT COUNT(*) FROM objects").getInt64());
      expect(known - std::min(known, checked_.size()));
    });
    for (const Id id : ids) {
      if (state_.sound.contains(id)) continue;
      const std::size_t errors = report_.errors.size();
      std::optional<ContentHash> contents;
      explaining_errors(
          [&] {
            const std::optional<Scan> scan = scan_if_there(id);
            if (scan) contents = check_scan(*scan);
          },
          "scan number " + std::to_string(id) + ": ");
      if (!contents || report_.errors.size() > errors) continue;
      state_.sound[id] = *contents;
      write_verify_state(store_.folder(), state_);
    }
    explaining_errors([&] { check_rest(); });
    report_.objects = checked_.size();
    remove_verify_state(store_.folder());
    return std::move(report_);
  }

  VerifyReport only(const std::vector<std::string>& names) {
    std::vector<Scan> scans;
    std::size_t objects = 0;
    for (const std::string& name : names) {
      scans.push_back(store_.scan(name));
      objects += objects_of_scan(database_, scans.back().id).size();
    }
    expect(objects);
    for (const Scan& scan : scans) explaining_errors([&] { check_scan(scan); }, "scan '" + scan.name + "': ");
    report_.objects = checked_.size();
    return std::move(report_);
  }

 private:
  // What the catalogue or the disk has against the check becomes a finding of it.
  template <class Work>
  void explaining_errors(const Work& work, const std::string& place = {}) {
    try {
      explaining(store_.folder(), work);
    } catch (const core::StoreError& error) {
      report_.errors.push_back(place + error.what());
    }
  }

  void expect(std::size_t objects) { progress_ = std::make_unique<core::Progress>("verify", objects); }

  // Others may remove scans meanwhile.
  std::optional<Scan> scan_if_there(Id id) const {
    try {
      return store_.scan(id);
    } catch (const core::UsageError&) {
      return std::nullopt;
    }
  }

  // Scans that were found sound, and are as they were.
  void take_up(const std::vector<Id>& ids) {
    const std::optional<VerifyState> before = read_verify_state(store_.folder());
    if (!before) return core::note("there is no interrupted verification: starting anew");
    if (before->store_id != state_.store_id) {
      return core::note("verify.json is of a verification of another store: starting anew");
    }
    for (const Id id : ids) {
      const auto sound = before->sound.find(id);
      if (sound == before->sound.end()) continue;
      explaining_errors(
          [&] {
            const std::optional<Scan> scan = scan_if_there(id);
            if (!scan) return;
            const SQLite::Transaction snapshot(database_);
            const Contents contents = contents_of(*scan);
            if (contents.hash != sound->second) return;
            for (const OwnedObject& object : contents.objects) checked_.insert({object.hash, {}});
            report_.frames += contents.frames;
            ++report_.scans_done_before;
            state_.sound.insert(*sound);
          },
          "scan number " + std::to_string(id) + ": ");
    }
  }

  // All that the check of a scan looks at.
  struct Contents {
    std::vector<OwnedObject> objects;
    std::vector<LitFrames> lit;
    std::size_t frames = 0;
    ContentHash hash;  // of the above and the steps
  };
  Contents contents_of(const Scan& scan) const {
    Contents contents{objects_of_scan(database_, scan.id), lit_frames(store_, scan), 0, {}};
    SQLite::Statement count(database_, "SELECT COUNT(*) FROM frames WHERE scan_id = ?");
    bind_all(count, scan.id);
    if (count.executeStep()) contents.frames = std::size_t(count.getColumn(0).getInt64());
    std::string text;
    const auto add = [&](const auto&... parts) { ((text += parts + std::string(1, '\0')), ...); };
    for (const std::string& camera : scan.cameras) add(camera);
    for (const Step& step : scan.steps) {
      add(std::to_string(step.step_index), std::string(to_string(step.kind)),
          std::to_string(step.light_index.value_or(-1)), std::to_string(step.exposure_ns), step.pattern);
    }
    for (const OwnedObject& object : contents.objects) add(object.owner, object.hash.hex());
    for (const LitFrames& lit : contents.lit) {
      add(lit.place, lit.mask ? lit.mask->hex() : std::string());
      for (std::size_t i = 0; i < lit.objects.size(); ++i) {
        const core::Light& light = lit.lights[i];
        add(lit.labels[i], lit.objects[i].hex());
        for (const double value : {light.direction.x(), light.direction.y(), light.direction.z(), light.gain[0],
                                   light.gain[1], light.gain[2]}) {
          add(core::number_text(value, 17));
        }
      }
      for (const ContentHash& dark : lit.dark) add(dark.hex());
    }
    contents.hash = hash_bytes({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
    return contents;
  }

  void check_catalogue() {
    const std::vector<std::size_t> damaged = damaged_pages(catalogue_path(store_.folder()));
    for (const std::size_t page : damaged) {
      report_.errors.push_back("catalogue: page " + std::to_string(page) +
                               " does not match its checksum: damaged, or written by a program that is not lightstage");
    }
    if (!damaged.empty()) sound_pages_ = open_sound_pages(catalogue_path(store_.folder()));
    SQLite::Statement check(database_, "PRAGMA integrity_check");
    while (check.executeStep()) {
      std::istringstream findings(check.getColumn(0).getString());  // a line each, below a heading of stars
      for (std::string line; std::getline(findings, line);) {
        if (line != "ok" && !line.starts_with("***")) report_.errors.push_back("catalogue: " + line);
      }
    }
    SQLite::Statement dangling(database_, "PRAGMA foreign_key_check");
    while (dangling.executeStep()) {
      report_.errors.push_back("catalogue: a row of table " + dangling.getColumn(0).getString() + " (" +
                               dangling.getColumn(1).getString() + ") refers to nothing in table " +
                               dangling.getColumn(2).getString());
    }
    if (schema_of(database_) != current_schema()) {
      report_.errors.push_back("catalogue: its tables are not those of schema version " +
                               std::to_string(schema_version()));
    }
  }

  // Returns the hash of what it looked at.
  ContentHash check_scan(const Scan& scan) {
    Contents contents;
    {
      // One view of the scan, whatever others write meanwhile.
      SQLite::Transaction snapshot(database_);
      name_rows_on_damaged_pages(scan);
      check_steps(scan);
      contents = contents_of(scan);
    }
    Thumbnails thumbnails;
    for (const LitFrames& frames : contents.lit) {
      for (const ContentHash& hash : frames.objects) thumbnails[hash];
      for (const ContentHash& hash : frames.dark) thumbnails[hash];
      if (frames.mask) thumbnails[*frames.mask];
    }
    check_objects(contents.objects, thumbnails);
    for (const LitFrames& frames : contents.lit) {
      for (std::string& error : misplaced_frames(frames, thumbnails)) report_.errors.push_back(std::move(error));
    }
    return contents.hash;
  }

  void name_rows_on_damaged_pages(const Scan& scan) {
    if (!sound_pages_) return;
    const auto readable = [&](const char* sql, const auto&... values) {
      try {
        SQLite::Statement row(*sound_pages_, sql);
        bind_all(row, values...);
        while (row.executeStep()) continue;
        return true;
      } catch (const SQLite::Exception&) {
        return false;
      }
    };
    if (readable("SELECT * FROM frames WHERE scan_id = ?", scan.id)) return;
    for (const Step& step : scan.steps) {
      for (const std::string& camera : scan.cameras) {
        if (readable("SELECT * FROM frames WHERE scan_id = ? AND step_index = ? AND camera = ?", scan.id,
                     step.step_index, camera))
          continue;
        report_.errors.push_back("scan '" + scan.name + "', step " + std::to_string(step.step_index) + ", camera '" +
                                 camera + "': its row is on a page of the catalogue that does not match its checksum");
      }
    }
  }

  void check_steps(const Scan& scan) {
    for (const std::string& camera : scan.cameras) {
      std::set<int> present;
      for (const Frame& frame : store_.frames(scan.id, camera)) present.insert(frame.step_index);
      report_.frames += present.size();
      if (present.size() == scan.steps.size()) continue;
      const auto first = std::find_if(scan.steps.begin(), scan.steps.end(),
                                      [&](const Step& step) { return !present.contains(step.step_index); });
      std::string remedy = "; an interrupted pass goes on with `lightstage capture --resume --name " + scan.name + "`";
      if (scan.kind == ScanKind::kImported) remedy.clear();
      if (scan.kind == ScanKind::kVirtual) remedy = "; the `lightstage superres` command that began it goes on with it";
      report_.errors.push_back("scan '" + scan.name + "', step " + std::to_string(first->step_index) +
                               (first->light_index ? " (light " + std::to_string(*first->light_index) + ")" : "") +
                               ", camera '" + camera + "': the frame is missing, the first of " +
                               std::to_string(scan.steps.size() - present.size()) + " that are" + remedy);
    }
  }

  // Objects of products that are about no scan, of whatever came since the scans were checked, and those that nothing refers to.
  void check_rest() {
    std::vector<OwnedObject> objects = objects_of_no_scan(database_);
    std::set<ContentHash> owned;
    for (const OwnedObject& object : objects) owned.insert(object.hash);
    const ObjectFiles::Listing listing = files_.list();
    std::size_t orphans = 0;
    for (const ContentHash& hash : listing.objects) {
      if (checked_.contains(hash) || owned.contains(hash)) continue;
      if (!is_referred_to(database_, hash)) ++orphans;
      objects.push_back({hash, {}});
    }
    Thumbnails none;
    check_objects(objects, none);
    if (orphans > 0) {
      report_.notes.push_back(
          core::counted(orphans, "object belongs", "objects belong") +
          " to no frame or product (left by a crash or a removed scan; harmless, `lightstage store gc` removes such)");
    }
    for (const ObjectFiles::Obstacle& obstacle : listing.obstacles) {
      if (obstacle.object && checked_.contains(*obstacle.object)) continue;  // told with its owner
      report_.errors.push_back(obstacle.place.string() + ": " + obstacle.what +
                               ", where only folders and files of objects belong; move it away, then `lightstage store "
                               "repair` puts in its place what there is a sound copy of");
    }
    for (const auto& stranger : listing.strangers) {
      report_.notes.push_back(stranger.string() + ": is no object (an interrupted write leaves such files; harmless)");
    }
  }

  // Reads every object once, but for those of which a thumbnail is wanted again.
  void check_objects(const std::vector<OwnedObject>& objects, Thumbnails& thumbnails) {
    std::vector<ContentHash> hashes;
    for (const OwnedObject& object : objects) {
      if (!checked_.contains(object.hash) || thumbnails.contains(object.hash)) hashes.push_back(object.hash);
    }
    std::sort(hashes.begin(), hashes.end());
    hashes.erase(std::unique(hashes.begin(), hashes.end()), hashes.end());
    std::vector<std::optional<std::string>> problems(hashes.size());
    core::parallel_for(hashes.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        core::throw_if_interrupted();
        problems[i] = check_object(hashes[i], thumbnails);
        if (progress_ && !checked_.contains(hashes[i])) progress_->advance();
      }
    });
    for (std::size_t i = 0; i < hashes.size(); ++i) checked_[hashes[i]] = problems[i];
    for (const OwnedObject& object : objects) {
      const std::optional<std::string>& problem = checked_.at(object.hash);
      if (!problem) continue;
      report_.errors.push_back((object.owner.empty() ? std::string() : object.owner + ": ") + "object " +
                               object.hash.hex() + " " + *problem);
    }
  }

  // Also takes the thumbnail, where one is wanted: an object is decoded while its bytes are still in the page
  // cache.
  std::optional<std::string> check_object(const ContentHash& hash, Thumbnails& thumbnails) const {
    if (auto problem = files_.problem(hash)) return problem;
    const auto wanted = thumbnails.find(hash);
    if (wanted == thumbnails.end()) return std::nullopt;
    try {
      wanted->second = shrink(core::read_image(files_.path(hash)), kShapeSide);
    } catch (const core::BadInput& error) {
      return std::string("is not an image: ") + error.what();
    }
    return std::nullopt;
  }

  const Store& store_;
  SQLite::Database& database_;
  const ObjectFiles& files_;
  std::optional<SQLite::Database> sound_pages_;  // of a catalogue that has others too
  std::unique_ptr<core::Progress> progress_;
  VerifyState state_;
  VerifyReport report_;
  std::map<ContentHash, std::optional<std::string>> checked_;  // with what is wrong
};

}  // namespace

VerifyReport Store::verify(const VerifyOptions& options) const {
  Verification verification(*this, impl_->database, impl_->objects);
  return options.scans.empty() ? verification.everything(options.resume) : verification.only(options.scans);
}

}  // namespace lightstage::db
