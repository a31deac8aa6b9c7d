// The pictures that `relight` writes: their names, and what the store knows of them.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "cli/relight/light_options.h"
#include "core/image.h"
#include "db/store.h"
#include "relight/picture.h"

namespace lightstage::cli {

// Where --out says that pictures go.
class PicturePlace {
 public:
  // Throws UsageError where `out` does not fit so many pictures: a single one may have a name of its own, which ends in .exr.
  PicturePlace(const std::filesystem::path& out, std::size_t pictures);

  bool is_folder() const { return is_folder_; }
  const std::filesystem::path& path() const { return out_; }  // the folder or the one file
  std::filesystem::path folder() const;

  // The name of a sequence's frame: DIR/STEM_0012.exr, or DIR/STEM.exr for the only one.
  std::filesystem::path file(const Sequence& sequence, int frame) const;

 private:
  std::filesystem::path out_;
  bool is_folder_ = false;
};

// Pictures of one scan in one folder, on the disk and in the store. Two pictures are the same when scan, calibration,
// alignment, mask, program version and recipe are: a recipe is the JSON of all else that decides how a picture looks.
class PictureFiles {
 public:
  // `input_products`: what the pictures are made from. `store` must outlive this.
  PictureFiles(db::Store& store, const db::Scan& scan, std::vector<db::Id> input_products,
               const std::filesystem::path& folder);

  // The stops of the PNG, where this very file (by its hash, and with its PNG) is on record as made by this recipe; nothing
  // where there is no file. Throws UsageError for a file that is there and was made otherwise or changed since, and for a PNG
  // alone that is not on record: it is somebody else's.
  std::optional<double> made_already(const std::filesystem::path& exr, const nlohmann::ordered_json& recipe) const;

  // Writes the picture (as relight::write_picture) and enters it. The entry is in the store before the file has its name, so
  // that a process killed at any time leaves no file without one. `origin` is entered with the recipe, but does not count when
  // recipes are compared: names of files that the recipe has the hashes of.
  relight::WrittenPicture write(const std::filesystem::path& exr, core::ImageView linear, double stops,
                                const nlohmann::ordered_json& recipe, const nlohmann::ordered_json& origin);

 private:
  struct Entry {
    std::string file_hash;
    db::ContentHash making;  // of recipe, inputs and version
    double stops = 0;
  };
  db::ContentHash making(const nlohmann::ordered_json& recipe, const db::NewProduct& inputs,
                         const std::string& version) const;

  db::Store& store_;
  db::NewProduct product_;                     // what all have in common
  std::multimap<std::string, Entry> entries_;  // by file
};

}  // namespace lightstage::cli
