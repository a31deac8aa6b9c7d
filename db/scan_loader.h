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
  std::optional<Id> flat_id;  // nothing also where the alignment had divided by one
  std::optional<Id> colour_id;

  // Those that there are, for a product made of the whole.
  std::vector<Id> products() const;
};

// The scan's lights, in the order of their first steps, with their images freed of ambient light (as dark_level; aligned images are free of it
// already), divided by the camera's flat field and the light's gain, and their colours by the camera's matrix, where the stage has these. Several
// exposures of a light are merged into one image (core/exposure_merge.h); the first light with values that saturate in all of them, a thousandth or more, is
// warned of. Lights that the calibration could not place are left out, and so, with a
// warning, are frames that the alignment excludes.
// The mask is the scan's newest "mask" product, less what an alignment moved in from outside the picture. Images are read when they are first used, which needs the
// store's folder but not this connection. A frame is not missed where the same light was shot alike before. Throws UsageError for an unknown scan or camera, or when neither a calibration nor nominal
// lights exist (saying what to run); StoreError when frames are missing (naming the first, and `capture
// --resume`), in the store or in the alignment.
LoadedScan load_scan(const Store& store, std::string_view name, const LoadOptions& options = {});

// The mean of the scan's dark frames of this exposure, or where there are none (0 stands for no particular one) of the longest, in which noise is
// least; empty where the scan has no dark frames.
core::Image dark_level(const Store& store, const Scan& scan, std::string_view camera, std::int64_t exposure_ns = 0);

// What a white, evenly lit scene looks like to the camera, 1 in the middle: the newest product of kind "flat_field" of the scan's stage and camera.
// Empty where there is none, or (with a warning) where it is of another size than the scan's frames.
struct FlatField {
  core::Image image;  // 1 channel, or as many as the frames
  std::optional<Id> id;
};
FlatField flat_field(const Store& store, const Scan& scan, std::string_view camera);

// One frame, linear, freed of ambient light (`dark`, as dark_level gives it) and divided by `flat`; empty images change nothing.
core::Image load_frame(const Store& store, const Frame& frame, core::ImageView dark, core::ImageView flat = {});

// Writes the scan as a folder that others read: NAME.lp beside one EXR a light and mask.png. The folder must
// not exist or be empty; it appears only when all is written. Images as load_scan gives them.
void export_lp(const Store& store, std::string_view name, const std::filesystem::path& folder);

}  // namespace lightstage::db
