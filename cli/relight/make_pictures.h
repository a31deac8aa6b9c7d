// The pictures of a command, made one after the other; those that are there already are left as they are.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "cli/relight/frame_pictures.h"
#include "cli/relight/picture_files.h"
#include "cli/relight/recipe.h"

namespace lightstage::cli {

// The pictures of one sequence.
struct PictureJob {
  Sequence sequence;
  Recipe recipe;
  // Of all its PNGs: as asked for, or as on record; else the first picture to be made decides.
  std::optional<double> stops;
  std::vector<bool> is_made = {};  // by frame
};

struct MadePicture {
  relight::WrittenPicture files;
  double stops = 0;
  bool already_made = false;
  FramePicture work = {};  // without the picture itself
};

// Finds what is made already, in a folder: a picture with a name of its own is made anew each time. Throws as
// PictureFiles::made_already, also where PNGs of one sequence differ in exposure; nothing is written.
void find_made_pictures(std::vector<PictureJob>& jobs, const PicturePlace& place, const PictureFiles& files);

// Makes the rest, with progress on stderr, and returns all in order. `make_interpolator` is called once, and only when there is a
// picture to make. Throws Interrupted between pictures or within one that is not written then.
std::vector<MadePicture> make_pictures(
    std::vector<PictureJob>& jobs, const PicturePlace& place, PictureFiles& files, const FrameOptions& options,
    core::ImageView mask, const std::function<std::unique_ptr<model::LightInterpolator>()>& make_interpolator);

}  // namespace lightstage::cli
