// What the readers of all layouts check of a set.
#pragma once

#include <filesystem>

#include "db/importers.h"

namespace lightstage::db {

// The folder that a file is in; "." for a bare file name.
std::filesystem::path folder_of(const std::filesystem::path& file);

// Throws BadInput unless `folder` is one.
void require_folder(const std::filesystem::path& folder);

// Throws BadInput when one picture stands for two lights.
void require_distinct(const PictureSet& set);

}  // namespace lightstage::db
