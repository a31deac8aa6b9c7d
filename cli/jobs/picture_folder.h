// Folders of loose pictures.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace lightstage::cli {

// "b2" before "b10".
bool natural_less(const std::string& a, const std::string& b);

// By its extension: what core::read_image reads.
bool is_picture(const std::filesystem::path& path);

// Names of the pictures in the folder (not below it), numbers in them in numerical order. Throws BadInput for what is no folder that can be
// read.
std::vector<std::string> pictures_in(const std::filesystem::path& folder);

}  // namespace lightstage::cli
