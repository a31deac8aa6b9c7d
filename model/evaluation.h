// Ranking methods on one scan.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "core/olat_scan.h"
#include "model/interpolator.h"

namespace lightstage::model {

struct MethodScore {
  std::string name;
  std::size_t images = 0;
  double rmse = 0;               // root of the mean over images of the mean squared error over the mask
  double h1 = 0;                 // likewise
  double dssim = 0;              // mean over images
  double flip = 0;               // mean over images; of display-encoded pictures even where values are linear
  double seconds_per_image = 0;  // of render() alone
};

// Display values of a linear image as errors are judged: scaled so that the scan's exposure is 1, clipped to [0, 1], encoded by the
// power 1/2.2, or left linear. Throws BadInput for an exposure that is not finite and > 0.
core::Image judged(core::ImageView linear, double exposure, bool linear_values);

// Makes an interpolator for a scan: fitted anew for every subset of lights that an evaluation leaves over.
using InterpolatorFactory = std::function<std::unique_ptr<LightInterpolator>(const core::OlatScan& scan)>;

struct EvaluationOptions {
  bool linear_values = false;
};

// Every `every`-th light in turn is left out and predicted from all the others (the published protocol). No method sees the light
// left out. The scale of values is the whole scan's exposure. Throws UsageError for every < 1 or a scan of one light, BadInput
// naming the method where a picture is not finite, Interrupted on Ctrl-C, and what fitting and loading throw. Shows progress.
std::vector<MethodScore> evaluate_held_out(const core::OlatScan& scan, std::span<const InterpolatorFactory> methods,
                                           int every, const EvaluationOptions& options = {});

// Compares with given truth at any directions; truth(i) is the linear image for directions[i], in the scan's pose and units; it is
// called once for each i in order. Methods are fitted once. Throws as above.
std::vector<MethodScore> evaluate_against_truth(const core::OlatScan& scan,
                                                std::span<const InterpolatorFactory> methods,
                                                std::span<const core::Direction> directions,
                                                const std::function<core::Image(std::size_t)>& truth,
                                                const EvaluationOptions& options = {});

// Directions for the second protocol: uniformly at random where the stage has lights (nearest light within twice the median
// spacing), the same for a seed; fewer are the first ones of more. Throws BadInput for no lights, or for lights so close together that they
// cover less than about a millionth of the sphere.
std::vector<core::Direction> off_grid_directions(std::span<const core::Direction> lights, std::size_t count,
                                                 std::uint64_t seed);

}  // namespace lightstage::model
