// What belongs to one scan, as the catalogue has it, for those who check or mend it.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include <SQLiteCpp/Database.h>

#include "core/image.h"
#include "core/light_list.h"
#include "db/content_hash.h"
#include "db/store.h"

namespace lightstage::db {

struct OwnedObject {
  ContentHash hash;
  std::string owner;  // "scan 'head', step 3, camera 'main'" or "mask (product 7), image 'mask' 0"
};

// Objects of the scan's frames and of the products about it, by step and product; an object that several own is there once for each.
std::vector<OwnedObject> objects_of_scan(SQLite::Database& database, Id scan_id);
// Objects of the products that are about no scan.
std::vector<OwnedObject> objects_of_no_scan(SQLite::Database& database);
// Whether anything refers to the object.
bool is_referred_to(SQLite::Database& database, const ContentHash& hash);

// The frames of one camera that one calibrated light lit: their pixels are held against the step table.
struct LitFrames {
  std::string place;                // "scan 'x', camera 'c'"
  std::vector<std::string> labels;  // "step 3 (light 2)", parallel to the next two
  std::vector<ContentHash> objects;
  std::vector<core::Light> lights;
  std::vector<ContentHash> dark;
  std::optional<ContentHash> mask;
};

// Empty for scans whose pictures are computed, or that no calibration describes.
std::vector<LitFrames> lit_frames(const Store& store, const Scan& scan);

// Small pictures of objects, linear; empty ones could not be read.
using Thumbnails = std::map<ContentHash, core::Image>;

// One line for each frame that seems to belong elsewhere (db/check/misplaced.h) and for a mask of another size.
std::vector<std::string> misplaced_frames(const LitFrames& frames, const Thumbnails& thumbnails);

}  // namespace lightstage::db
