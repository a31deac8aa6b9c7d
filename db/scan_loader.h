// From rows of the store to the OlatScan that models and relighting work on.
#pragma once

#include <string>
#include <string_view>

#include "core/olat_scan.h"
#include "db/store.h"

namespace lightstage::db {

struct LoadOptions {
  std::string camera;         // empty: the scan's first camera
  bool use_alignment = true;  // the newest alignment of that camera, if there is one
  // Directions for lights that no calibration places (nominal ones of a stage file), by light_index; empty:
  // such a scan is refused.
  std::vector<core::Light> nominal_lights;
};

// Where the parts of a loaded scan came from, for reports and products' inputs.
struct LoadedScan {
  core::OlatScan scan;
  std::vector<int> light_index;      // per light of `scan`: its index in the stage's list
  std::optional<Id> calibration_id;  // nothing: nominal lights were used
  std::optional<Id> alignment_id;
  std::optional<Id> mask_id;

  // Those of the three that there are, for a product made of the whole.
  std::vector<Id> products() const;
};

// The scan's lights, in the order of their first steps, with their images divided by the light's gain and
// freed of ambient light (mean of the dark frames, if any; aligned images are free of it already). Several
// exposures of a light are merged into one image. Lights that the calibration could not place are left out, and so, with a
// warning, are frames that the alignment excludes.
// The mask is the scan's newest "mask" product, less what an alignment moved in from outside the picture. Images are read when they are first used, which needs the
// store's folder but not this connection. A frame is not missed where the same light was shot alike before. Throws UsageError for an unknown scan or camera, or when neither a calibration nor nominal
// lights exist (saying what to run); StoreError when frames are missing (naming the first, and `capture
// --resume`), in the store or in the alignment.
LoadedScan load_scan(const Store& store, std::string_view name, const LoadOptions& options = {});

// The mean of the scan's dark frames; empty where there are none.
core::Image dark_level(const Store& store, const Scan& scan, std::string_view camera);
// One frame, linear, freed of ambient light (the mean of `dark`, as dark_level gives it; an empty image
// subtracts nothing).
core::Image load_frame(const Store& store, const Frame& frame, core::ImageView dark);

// Writes the scan as a folder that others read: NAME.lp beside one EXR a light and mask.png. The folder must
// not exist or be empty; it appears only when all is written. Images as load_scan gives them.
void export_lp(const Store& store, std::string_view name, const std::filesystem::path& folder);

}  // namespace lightstage::db
