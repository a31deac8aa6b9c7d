// Loose pictures with their exposure times, as commands take them.
#pragma once

#include <CLI/App.hpp>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/image_file.h"

namespace lightstage::cli {

struct ExposureFiles {
  std::vector<std::filesystem::path> pictures;
  std::string times;          // --exposures
  std::filesystem::path csv;  // --csv
};

// PICTURE..., --exposures and --csv.
void add_exposure_options(CLI::App& command, ExposureFiles& files);

// --encoding linear|srgb.
void add_encoding_option(CLI::App& command, core::Encoding& encoding, const std::string& usual);

struct ExposedPictures {
  std::vector<std::filesystem::path> files;
  std::vector<double> seconds;
  std::vector<core::Image> images;  // 1 or 3 channels
};

// Throws UsageError where pictures and times do not go together, BadInput with file (and line of a CSV) for what cannot be read, for
// pictures of different sizes, and for times that cannot be those of the pictures: more than a tenth darker with a longer exposure.
ExposedPictures read_exposed_pictures(const ExposureFiles& files, core::Encoding encoding);

// A picture of 1 or 3 channels: alpha is dropped.
core::Image read_picture(const std::filesystem::path& file, core::Encoding encoding);

// ".exr" of "A.EXR".
std::string lower_case_extension(const std::filesystem::path& file);

// The value at which a picture file of this encoding clips where nothing else is said: 1 for integers, 0 (not known) for floats.
double usual_saturation(const std::filesystem::path& file);

}  // namespace lightstage::cli
