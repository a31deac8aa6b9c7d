// What relighting by plan saves, measured on a simulated stage against exhaustive synthesis and against the simulator's truth.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "cli/jobs/simulated_stage.h"
#include "model/interpolator.h"
#include "relight/environment_relighter.h"

namespace lightstage::cli {

struct NamedEnvironment {
  std::string name;
  relight::Environment map;
};

// A clear sky with its sun, a room with two windows and a lamp, an overcast sky, and noise of all degrees up to 12; then the files.
std::vector<NamedEnvironment> bench_environments(const std::vector<std::filesystem::path>& files);

// One environment, exhaustively and by plan.
struct MatchedRow {
  std::string environment;
  int degree_90 = 0;
  double asked = 0;                             // DSSIM
  std::size_t exhaustive = 0, synthesised = 0;  // pictures, of the small map
  double exhaustive_s = 0, planned_s = 0;
  double dssim = 0, dssim_estimate = 0, relative_rms = 0;
  std::size_t synthesised_of_full = 0;  // by the same plan for the map at 256 x 128
  std::size_t lit_of_full = 0;          // its lit pixels
  double planned_of_full_s = 0;
};

// Every environment at width x height pixels is summed exhaustively, all of them in one pass over the directions, and then by plan for each of the asked errors.
// Rows in the order of environments, for each the errors as given; `seconds_per_picture` is what one synthesised picture of that pass took.
struct MatchedTable {
  std::vector<MatchedRow> rows;
  double seconds_per_picture = 0;
};
MatchedTable matched_errors(const model::LightInterpolator& method, const std::vector<NamedEnvironment>& environments,
                            int width, int height, const std::vector<double>& asked);

// What super-resolution gains over blending under one environment and on a stage of so many lights.
struct GainRow {
  std::string environment;
  std::size_t lights = 0;
  int degree_90 = 0;
  double between = 0;                          // DSSIM of the network's picture from the linear one's
  double network_error = 0, linear_error = 0;  // DSSIM from the simulator's truth
};

// Each environment as it is and blurred more and more (heat kernels), gathered onto `directions` directions where the stage has lights; pictures under those are made by the
// simulator, the network and linear blending. Stages of `lights` each.
std::vector<GainRow> gains(const SimulatedStageOptions& stage, const std::vector<std::size_t>& lights,
                           const std::vector<NamedEnvironment>& environments, std::size_t directions);

// An area light of this radius between the stage's lights, by network and linear blending, against the mean of the simulator's pictures over its disc.
struct ShadowRow {
  double radius_degrees = 0;
  double network_rmse = 0, linear_rmse = 0, network_dssim = 0, linear_dssim = 0;
  std::size_t synthesised = 0;
};
std::vector<ShadowRow> soft_shadows(const SimulatedStage& stage, const model::LightInterpolator& network,
                                    const std::vector<double>& radii);

}  // namespace lightstage::cli
