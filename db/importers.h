// Real photographs into the store: the layouts in which multi-light sets are found.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/direction.h"
#include "core/image_file.h"
#include "db/store.h"

namespace lightstage::db {

struct PictureEntry {
  std::filesystem::path path;
  core::Direction direction;
  std::array<double, 3> intensity{1, 1, 1};  // the light's relative strength: the picture is divided by it on loading
};

// A set of pictures as found on disk, not yet read.
struct PictureSet {
  std::string format;  // "lp", "diligent", "yale", "csv"
  std::filesystem::path source;
  std::vector<PictureEntry> pictures;
  std::optional<std::filesystem::path> mask;     // white inside
  std::optional<std::filesystem::path> ambient;  // taken with all stage lights off
  // Applied on loading, after the lights' strength: a row a channel of what comes out. Kept as a product of kind "colour".
  std::optional<std::array<std::array<double, 3>, 3>> colour;
  core::Encoding encoding = core::Encoding::kAuto;
};

// Each reader looks at names and lists only, and throws BadInput with file and line for what is missing or
// malformed: a light without picture or a picture without light, more lights than pictures, one picture for
// two lights, a zero direction, a path that leaves the folder. A mask.png beside the list is taken as the
// set's mask.

// RTI: PATH is an .lp file, pictures are relative to its folder (where a listed path is not there, its file
// name beside the .lp is tried).
PictureSet read_lp_set(const std::filesystem::path& path);
// DiLiGenT: PATH is a folder with filenames.txt, light_directions.txt (a row a light: x y z),
// light_intensities.txt (r g b; optional). Without filenames.txt the pictures are 001.png and so on after the
// lines. Pictures are linear.
PictureSet read_diligent_set(const std::filesystem::path& path);
// Extended Yale Face Database B: PATH is a folder of NAME_PnnA<azimuth>E<elevation>.pgm (degrees, positive
// azimuth is light from image left) and NAME_Pnn_Ambient.pgm. Pictures are linear. An ambient picture of
// another size than the set is refused by name.
PictureSet read_yale_set(const std::filesystem::path& path);
// A CSV with a header line naming columns: file, and x,y,z or longitude,latitude (degrees); optional r,g,b or
// intensity. PATH is the file, or a folder that holds one lights.csv.
PictureSet read_csv_set(const std::filesystem::path& path);

struct ImportReport {
  Id scan_id = 0;
  std::size_t pictures = 0;
  core::ImageSize size;
  // Lights whose picture is not to be used, each with its reason, marked as not placed in the calibration so that nothing uses them:
  // - files that gave no picture (truncated, not finite), up to one in ten; they are no part of the scan;
  // - pictures kept in the store that are black, torn by interlacing, mislabelled, or swapped with another: predicted far worse by their
  //   neighbours than the set's others are (db/check/damaged.h, swapped.h). Sets of fewer than 16 pictures are judged for black ones alone.
  std::vector<CalibratedLight> excluded;
};

// Reads every picture, checks it and stores the set as a scan of kind kImported with a
// calibration from the given directions, in such a way that a failure leaves the store as it was. `encoding`
// overrides the set's. BadInput when pictures differ in size, or more than one in ten gives no picture (naming the first).
ImportReport import_pictures(Store& store, const PictureSet& set, const std::string& name,
                             std::optional<core::Encoding> encoding = std::nullopt);

}  // namespace lightstage::db
