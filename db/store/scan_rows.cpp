// Store: scans with their cameras and steps.
#include <algorithm>
#include <array>
#include <cctype>
#include <set>

#include "core/clock.h"
#include "core/error.h"
#include "core/printable.h"
#include "core/text.h"
#include "core/version.h"
#include "db/store/impl.h"

namespace lightstage::db {
namespace {

// In the order of the enumerations.
constexpr std::array<std::string_view, 6> kScanKinds{"olat",       "mirror_ball", "grey_ball",
                                                     "chessboard", "imported",    "virtual"};
constexpr std::array<std::string_view, 5> kStepKinds{"light", "tracking", "full_on", "dark", "pattern"};

// The schema lets no other text in; a catalogue that was not written through it may hold any.
template <class Kind, std::size_t n>
Kind parse_kind(const std::array<std::string_view, n>& names, const std::string& text, const std::string& place) {
  const auto found = std::find(names.begin(), names.end(), text);
  if (found == names.end()) throw core::StoreError(place + "there is no kind " + core::quoted(text));
  return Kind(found - names.begin());
}

void check_name(const std::string& name, const std::string& what) {
  const auto allowed = [](unsigned char c) { return std::isalnum(c) || c == '-' || c == '_' || c == '.'; };
  if (name.empty() || name[0] == '.' || !std::all_of(name.begin(), name.end(), allowed)) {
    throw core::UsageError(core::quoted(name) + " cannot name a " + what +
                           "; use letters, digits, '-', '_' and '.', not starting with '.'");
  }
}

// Names become those of files and folders.
void check_names_read(const Scan& scan, const std::string& place) {
  try {
    check_name(scan.name, "scan");
    for (const std::string& camera : scan.cameras) check_name(camera, "camera");
  } catch (const core::UsageError& error) {
    throw core::StoreError(place + error.what());
  }
}

void check_steps(const NewScan& scan) {
  std::set<int> seen;
  for (const Step& step : scan.steps) {
    const std::string place = "scan '" + scan.name + "', step " + std::to_string(step.step_index) + ": ";
    if (step.step_index < 0) throw core::BadInput(place + "steps count from 0");
    if (!seen.insert(step.step_index).second) throw core::BadInput(place + "listed twice");
    if (step.exposure_ns < 0) throw core::BadInput(place + "its exposure is negative");
    if ((step.kind == StepKind::kLight) != step.light_index.has_value()) {
      throw core::BadInput(place + "a step has a light exactly if its kind is 'light'");
    }
    if (step.light_index && *step.light_index < 0) throw core::BadInput(place + "lights count from 0");
    if (step.kind == StepKind::kPattern) {
      require_json(step.pattern, place + "its pattern");
    } else if (!step.pattern.empty()) {
      throw core::BadInput(place + "only a step of kind 'pattern' has a pattern");
    }
  }
}

void check_scan(const NewScan& scan) {
  for (std::size_t i = 0; i < scan.cameras.size(); ++i) {
    check_name(scan.cameras[i], "camera");
    if (std::find(scan.cameras.begin(), scan.cameras.begin() + std::ptrdiff_t(i), scan.cameras[i]) !=
        scan.cameras.begin() + std::ptrdiff_t(i)) {
      throw core::BadInput("scan '" + scan.name + "': camera '" + scan.cameras[i] + "' is listed twice");
    }
  }
  require_json(json_or_empty(scan.provenance), "scan '" + scan.name + "': its provenance");
  check_steps(scan);
}

void insert_steps(SQLite::Database& database, Id scan_id, const std::vector<Step>& steps) {
  SQLite::Statement insert(database,
                           "INSERT INTO steps (scan_id, step_index, kind, light_index, exposure_ns, pattern) "
                           "VALUES (?, ?, ?, ?, ?, ?)");
  for (const Step& step : steps) {
    bind_all(insert, scan_id, step.step_index, to_string(step.kind), step.light_index, step.exposure_ns, step.pattern);
    insert.exec();
    insert.reset();
  }
}

constexpr const char* kScanColumns =
    "SELECT id, name, kind, stage_key, provenance, created_utc, program_version FROM scans ";

}  // namespace

std::string_view to_string(ScanKind kind) {
  return kScanKinds.at(std::size_t(kind));
}
std::string_view to_string(StepKind kind) {
  return kStepKinds.at(std::size_t(kind));
}

const Step& step_of(const Scan& scan, int step_index) {
  const auto step = std::lower_bound(scan.steps.begin(), scan.steps.end(), step_index,
                                     [](const Step& s, int index) { return s.step_index < index; });
  if (step == scan.steps.end() || step->step_index != step_index) {
    throw core::StoreError("scan '" + scan.name + "' has no step " + std::to_string(step_index));
  }
  return *step;
}

void Store::require_free_name(const std::string& name) const {
  check_name(name, "scan");
  if (find_scan(name)) {
    throw core::UsageError(folder().string() + ": there is a scan '" + name + "' already; choose another name");
  }
}

Id Store::add_scan(const NewScan& scan) {
  check_scan(scan);
  return impl_->write([&] {
    require_free_name(scan.name);
    impl_->change(
        "INSERT INTO scans (name, kind, stage_key, provenance, created_utc, program_version) VALUES (?, ?, "
        "?, ?, ?, ?)",
        scan.name, to_string(scan.kind), scan.stage_key, json_or_empty(scan.provenance), core::utc_timestamp(),
        std::string_view(core::kVersion));
    const Id id = impl_->database.getLastInsertRowid();
    for (std::size_t i = 0; i < scan.cameras.size(); ++i) {
      impl_->change("INSERT INTO cameras (scan_id, position, name) VALUES (?, ?, ?)", id, int(i), scan.cameras[i]);
    }
    insert_steps(impl_->database, id, scan.steps);
    return id;
  });
}

void Store::extend_scan(Id scan_id, const std::vector<Step>& steps, const std::string& provenance) {
  impl_->write([&] {
    NewScan extended = scan(scan_id);
    extended.steps.insert(extended.steps.end(), steps.begin(), steps.end());
    extended.provenance = provenance;
    check_scan(extended);
    impl_->change("UPDATE scans SET provenance = ? WHERE id = ?", json_or_empty(provenance), scan_id);
    insert_steps(impl_->database, scan_id, steps);
  });
}

Scan Store::Impl::scan_from(SQLite::Statement& row) const {
  Scan scan;
  scan.id = row.getColumn(0).getInt64();
  scan.name = row.getColumn(1).getString();
  const std::string place = folder.string() + ": scan " + core::quoted(scan.name) + ": ";
  scan.kind = parse_kind<ScanKind>(kScanKinds, row.getColumn(2).getString(), place);
  scan.stage_key = row.getColumn(3).getString();
  scan.provenance = shallow_json(row.getColumn(4).getString(), place + "its provenance");
  scan.created_utc = row.getColumn(5).getString();
  scan.program_version = row.getColumn(6).getString();
  auto cameras = query("SELECT name FROM cameras WHERE scan_id = ? ORDER BY position", scan.id);
  while (cameras.executeStep()) scan.cameras.push_back(cameras.getColumn(0).getString());
  check_names_read(scan, place);
  auto steps = query(
      "SELECT step_index, kind, light_index, exposure_ns, pattern FROM steps WHERE scan_id = ? ORDER BY "
      "step_index",
      scan.id);
  while (steps.executeStep()) {
    Step step;
    step.step_index = int_at(steps, 0, place + "step");
    step.kind = parse_kind<StepKind>(kStepKinds, steps.getColumn(1).getString(), place);
    if (!steps.getColumn(2).isNull()) step.light_index = int_at(steps, 2, place + "light");
    if ((step.kind == StepKind::kLight) != step.light_index.has_value()) {
      throw core::StoreError(place + "step " + std::to_string(step.step_index) +
                             ": a step has a light exactly if its kind is 'light'");
    }
    step.exposure_ns = steps.getColumn(3).getInt64();
    step.pattern = shallow_json(steps.getColumn(4).getString(), place + "a pattern");
    scan.steps.push_back(std::move(step));
  }
  return scan;
}

std::optional<Scan> Store::find_scan(std::string_view name) const {
  return explaining(folder(), [&]() -> std::optional<Scan> {
    auto row = impl_->query((std::string(kScanColumns) + "WHERE name = ?").c_str(), name);
    if (!row.executeStep()) return std::nullopt;
    return impl_->scan_from(row);
  });
}

Scan Store::scan(std::string_view name) const {
  if (auto found = find_scan(name)) return *std::move(found);
  std::vector<std::string> names;
  for (const Scan& known : scans()) names.push_back(known.name);
  throw core::UsageError(folder().string() + ": there is no scan '" + std::string(name) + "'" +
                         core::did_you_mean(name, names) + "; `lightstage store ls` lists all");
}

Scan Store::scan(Id id) const {
  return explaining(folder(), [&] {
    auto row = impl_->query((std::string(kScanColumns) + "WHERE id = ?").c_str(), id);
    if (!row.executeStep()) {
      throw core::UsageError(folder().string() + ": there is no scan with id " + std::to_string(id));
    }
    return impl_->scan_from(row);
  });
}

std::vector<Scan> Store::scans() const {
  return explaining(folder(), [&] {
    std::vector<Scan> all;
    auto row = impl_->query((std::string(kScanColumns) + "ORDER BY id").c_str());
    while (row.executeStep()) all.push_back(impl_->scan_from(row));
    return all;
  });
}

std::vector<ScanSummary> Store::scan_summaries() const {
  return explaining(folder(), [&] {
    std::vector<ScanSummary> all;
    auto row = impl_->query(
        "SELECT id, name, kind, created_utc, (SELECT COUNT(*) FROM steps WHERE scan_id = scans.id), "
        "(SELECT COUNT(*) FROM frames WHERE scan_id = scans.id) FROM scans ORDER BY id");
    while (row.executeStep()) {
      ScanSummary scan;
      scan.name = row.getColumn(1).getString();
      scan.kind = parse_kind<ScanKind>(kScanKinds, row.getColumn(2).getString(), folder().string() + ": ");
      scan.created_utc = row.getColumn(3).getString();
      scan.steps = std::size_t(row.getColumn(4).getInt64());
      scan.frames = std::size_t(row.getColumn(5).getInt64());
      auto cameras =
          impl_->query("SELECT name FROM cameras WHERE scan_id = ? ORDER BY position", row.getColumn(0).getInt64());
      while (cameras.executeStep()) scan.cameras.push_back(cameras.getColumn(0).getString());
      all.push_back(std::move(scan));
    }
    return all;
  });
}

std::vector<Product> Store::remove_scan(Id scan_id) {
  // The scan's own products, what others were made from it or from them, and the weights among these.
  const std::string heirs_and_weights =
      "WITH own AS (SELECT id FROM products WHERE scan_id = ?1),"
      "  heirs AS (SELECT id, kind FROM products WHERE scan_id IS NOT ?1 AND"
      "    (id IN (SELECT product_id FROM product_input_scans WHERE scan_id = ?1) OR"
      "     id IN (SELECT product_id FROM product_input_products WHERE input_id IN own))),"
      "  weights AS (SELECT id FROM heirs WHERE kind = 'weights') ";
  return impl_->write([&] {
    const Scan removed = scan(scan_id);
    auto heir =
        impl_->query((heirs_and_weights +
                      "SELECT kind, name, id FROM products WHERE id NOT IN weights AND scan_id IS NOT ?1 AND"
                      "  (id IN (SELECT id FROM heirs) OR"
                      "   id IN (SELECT product_id FROM product_input_products WHERE input_id IN weights)) ORDER BY id")
                         .c_str(),
                     scan_id);
    // It would lose its origin.
    if (heir.executeStep()) {
      throw core::UsageError(folder().string() + ": scan '" + removed.name + "' cannot be removed: " +
                             heir.getColumn(0).getString() + " '" + heir.getColumn(1).getString() + "' (product " +
                             std::to_string(heir.getColumn(2).getInt64()) + ") was made from it");
    }
    std::set<Id> trained;
    auto row = impl_->query((heirs_and_weights + "SELECT id FROM weights").c_str(), scan_id);
    while (row.executeStep()) trained.insert(row.getColumn(0).getInt64());
    std::vector<Product> weights;
    for (Product& product : products("weights")) {
      if (!trained.contains(product.id)) continue;
      impl_->change("DELETE FROM products WHERE id = ?", product.id);
      weights.push_back(std::move(product));
    }
    impl_->change("DELETE FROM scans WHERE id = ?", scan_id);
    return weights;
  });
}

}  // namespace lightstage::db
