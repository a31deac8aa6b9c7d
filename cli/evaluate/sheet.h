// One picture of what every method made of some directions.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "cli/jobs/method_options.h"
#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"

namespace lightstage::cli {

// Writes truth, methods and differences side by side for some of the brighter directions; `truth` are linear pictures, one a direction.
void write_sheet(const std::filesystem::path& path, const core::OlatScan& scan,
                 const std::vector<MethodChoice>& choices, std::span<const core::Direction> directions,
                 std::span<const core::Image> truth, bool linear);

}  // namespace lightstage::cli
