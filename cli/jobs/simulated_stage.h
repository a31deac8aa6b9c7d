// A simulated scan in memory, without noise or motion, and the truth between its lights.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"
#include "sim/world.h"

namespace lightstage::cli {

struct SimulatedStageOptions {
  std::size_t lights = 302;
  int pixels = 128;            // of the square picture
  std::filesystem::path mesh;  // a head; empty: a procedural one
  std::uint64_t seed = 9001;   // of the procedural one
};

class SimulatedStage {
 public:
  // A geodesic stage with the holes of capture::LayoutOptions. Renders every light's picture. Throws BadInput for a mesh that cannot be read.
  explicit SimulatedStage(const SimulatedStageOptions& options);

  const core::OlatScan& scan() const { return scan_; }

  // What the camera sees under unit lights in these directions.
  std::vector<core::Image> truth(std::span<const core::Direction> directions) const;

 private:
  sim::World world_;
  core::OlatScan scan_;
};

}  // namespace lightstage::cli
