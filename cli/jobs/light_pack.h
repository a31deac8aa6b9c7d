// Packs of virtual scans (relight/light_pack.h) in the store: products of kind "light_pack".
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "cli/jobs/method_options.h"
#include "db/scan_loader.h"
#include "db/store.h"
#include "relight/light_pack.h"

namespace lightstage::cli {

// What a scan's newest pack is, without its pictures.
struct PackInfo {
  db::Id id = 0;
  double asked_error = 0;
  std::size_t rank = 0;
  relight::PackErrors errors;
  std::uintmax_t bytes = 0;  // of its files
};

// Stores the pack of this scan. Its row comes last: what an interrupted run leaves is no pack.
PackInfo store_pack(db::Store& store, const db::LoadedScan& scan, db::Id scan_id, const relight::LightPack& pack,
                    double asked_error);

// Nothing where the scan has none. Throws StoreError for one that is damaged or of another program.
std::optional<PackInfo> find_pack(const db::Store& store, db::Id scan_id);

// The scan by its newest pack. Every object is checked. Throws StoreError for a pack that is missing, damaged or of another program.
std::unique_ptr<relight::PackedScan> load_pack(const db::Store& store, const db::LoadedScan& scan, db::Id scan_id);

// Whether a picture of the scan is to come from its pack: `--method pack`, or no method named (or auto) for a scan that has one. Throws UsageError
// for `--method pack` where there is none, or with knobs.
bool takes_pack(const MethodChoice& choice, const db::Store& store, const db::Scan& scan);

// For results and provenance.
nlohmann::ordered_json to_json(const PackInfo& pack);

}  // namespace lightstage::cli
