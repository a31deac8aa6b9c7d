// Subjects, stages and cameras made up at random, for training a network that is to work on every stage.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "model/training.h"

namespace lightstage::cli {

struct SimulatedViewsOptions {
  std::size_t views = 200;
  // Head meshes (.ply, .obj, ...); every second view shows one of them, the others (all, without meshes) a procedural head.
  std::vector<std::filesystem::path> meshes;
  std::uint64_t seed = 1;
};

// Views of 128 x 128 pixels, of a whole head or down to a third of it: stages of 48 to 331 lights, whole or a dome, about 6 to 30 degrees apart and turned at
// random; 64 queries where the stage has lights, mostly in front of the subject; one subject a view, turned up to 60 degrees, its colour
// changed at random; half the views with the noise of a sensor of 3,000 to 30,000 electrons. A view takes about 2 s on two cores. Reads every mesh once before the first view; throws
// BadInput naming one that cannot be read.
model::SimulatedViews simulated_views(const SimulatedViewsOptions& options);

}  // namespace lightstage::cli
