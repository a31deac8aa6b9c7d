// Ranking methods on one scan.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"
#include "model/interpolator.h"

namespace lightstage::model {

// One prediction, judged (model/metrics.h).
struct ImageScore {
  std::size_t index = 0;        // of the light left out, or of the direction asked for
  double degrees_to_light = 0;  // from the query to the nearest light that the method had
  double mean_squared_error = 0, squared_h1 = 0, dssim = 0, msssim = 0, gmsd = 0;
  double flip = 0;                  // of display-encoded pictures even where values are linear
  std::optional<double> hdr_flip;   // where it was asked for; of linear radiance always
  std::optional<double> own_error;  // by EvaluationOptions::own_metric, where there is one
  double seconds = 0;               // of render() alone
};

// The predictions at angles from `from_deg` (inclusive) to `to_deg` (exclusive) from the nearest light that the method had.
struct AngleBin {
  double from_deg = 0, to_deg = 0;
  std::size_t images = 0;
  std::optional<double> rmse, dssim;  // nothing without images
};

struct MethodScore {
  std::string name;
  std::size_t images = 0;
  double rmse = 0;  // root of the mean over images of the mean squared error over the mask
  double h1 = 0;    // likewise
  // Means over images, as in ImageScore; of msssim alone more is better.
  double dssim = 0, msssim = 0, gmsd = 0, flip = 0;
  std::optional<double> hdr_flip, own_error;
  double seconds_per_image = 0;
  std::vector<AngleBin> by_angle;  // ten bins of 1.5 degrees, and one for 15 degrees and more (to_deg 180)
  // The most memory that the process held while this method was fitted and rendered: what is loaded for all methods (captured images, truth)
  // and the method's own. Nothing where the system does not let a process count anew.
  std::optional<std::size_t> peak_rss_bytes;
  std::vector<ImageScore> each;  // in the order of the queries
};

// Display values of a linear image as errors are judged: scaled so that the scan's exposure is 1, clipped to [0, 1], encoded by the
// power 1/2.2, or left linear. Throws BadInput for an exposure that is not finite and > 0.
core::Image judged(core::ImageView linear, double exposure, bool linear_values);

// Makes an interpolator for a scan: fitted anew for every subset of lights that an evaluation leaves over.
using InterpolatorFactory = std::function<std::unique_ptr<LightInterpolator>(const core::OlatScan& scan)>;

// As model/metrics.h: truth, picture, mask.
using Metric = std::function<double(core::ImageView, core::ImageView, core::ImageView)>;

struct EvaluationOptions {
  bool linear_values = false;  // judge linear values with all but flip, hdr_flip and own_metric
  bool hdr_flip = false;       // takes some ten times as long as flip
  Metric own_metric = {};      // given display-encoded pictures always
};

// Every `every`-th light in turn is left out and predicted from all the others (the published protocol). No method sees the light
// left out. The scale of values is the whole scan's exposure. Throws UsageError for every < 1 or a scan of one light, BadInput
// naming the method where a picture is not finite, Interrupted on Ctrl-C, and what fitting and loading throw. Shows progress.
std::vector<MethodScore> evaluate_held_out(const core::OlatScan& scan, std::span<const InterpolatorFactory> methods,
                                           int every, const EvaluationOptions& options = {});

// Compares with given truth at any directions; truth(i) is the linear image for directions[i], in the scan's pose and units; it is
// called for each i in order, by every method anew. Methods are fitted once, one after the other. Throws as above.
std::vector<MethodScore> evaluate_against_truth(const core::OlatScan& scan,
                                                std::span<const InterpolatorFactory> methods,
                                                std::span<const core::Direction> directions,
                                                const std::function<core::Image(std::size_t)>& truth,
                                                const EvaluationOptions& options = {});

// The scan without one of its lights.
core::OlatScan without_light(const core::OlatScan& scan, std::size_t left_out);

// Directions for the second protocol: uniformly at random where the stage has lights (nearest light within twice the median
// spacing), the same for a seed; fewer are the first ones of more. Throws BadInput for no lights, or for lights so close together that they
// cover less than about a millionth of the sphere.
std::vector<core::Direction> off_grid_directions(std::span<const core::Direction> lights, std::size_t count,
                                                 std::uint64_t seed);

// The indices of n lights that are spread as well as is simple: the one nearest to the front (+z), then always the one farthest from those chosen
// (Gonzalez 1985, "Clustering to minimize the maximum intercluster distance": their largest hole is at most twice as wide as it must be). Fewer are
// the first of more; all of them where n is larger. In ascending order. Throws UsageError for n = 0.
std::vector<std::size_t> well_spread(std::span<const core::Direction> lights, std::size_t n);

// How many neighbours the publication blends on a stage of n lights (Sun et al. 2020, section 5.3): 8, 7, 6, 5 and 4 for 302, 250, 200, 150 and 100
// lights, on a line in between, and no more or fewer than those.
int published_neighbours(std::size_t n);

}  // namespace lightstage::model
