// A denser stage than the one that was built.
#pragma once

#include <string>
#include <vector>

#include "core/direction.h"
#include "core/error.h"
#include "db/scan_loader.h"
#include "db/store.h"
#include "model/interpolator.h"

namespace lightstage::cli {

struct SuperresReport {
  std::size_t lights = 0;
  std::size_t already_stored = 0;
  double seconds_per_image = 0;
};

// n directions of a Fibonacci lattice where the stage has lights (nearest one within twice the median spacing).
std::vector<core::Direction> virtual_directions(const std::vector<core::Direction>& lights, std::size_t n);

// That the scan cannot be gone on with, since it is not what is asked for now.
core::UsageError made_otherwise(const std::string& scan);

// Renders every direction and stores the pictures as the virtual scan `out`, with the source as its input; going on where an
// earlier run of the same parameters stopped. Throws UsageError when `out` exists with other parameters.
SuperresReport superres(db::Store& store, const db::LoadedScan& source, const db::Scan& source_scan,
                        const model::LightInterpolator& interpolator, const std::string& parameters,
                        const std::vector<core::Direction>& directions, const std::string& out);

}  // namespace lightstage::cli
