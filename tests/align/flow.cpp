#include "align/flow.h"

#include <catch2/catch.hpp>
#include <iostream>
#include <limits>
#include <opencv2/core.hpp>

#include "align/moving_pictures.h"
#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::align {

TEST_CASE("explore") {
  const test::Texture texture(7);
  const core::Image ref = test::picture_of(texture, 256, 256);
  for (const double s : {0.0, 0.1, 0.3, 0.5, 1.0, 2.7, 5.3, 8.0}) {
    const test::Motion motion = [&](double, double) { return std::pair{s, -0.6 * s}; };
    const core::Image other = test::moved_picture_of(texture, 256, 256, motion);
    const auto truth = test::flow_of(motion, 256, 256);
    std::cout << s;
    for (const auto preset : {FlowPreset::kFast, FlowPreset::kMedium, FlowPreset::kFine}) {
      std::cout << "  clean " << test::median_end_point_error(compute_flow(ref, other, preset), truth, 16) << " noisy "
                << test::median_end_point_error(compute_flow(test::noisy(ref, 0.2, 1), test::noisy(other, 0.2, 2), preset), truth, 16);
    }
    std::cout << "\n";
  }
  const test::Motion wobble = [](double x, double y) { return std::pair{3 * std::sin(x / 40) + 0.02 * y, 2.5 * std::cos(y / 50) - 0.01 * x}; };
  const core::Image other = test::moved_picture_of(texture, 256, 256, wobble);
  const auto truth = test::flow_of(wobble, 256, 256);
  std::cout << "wobble ";
  for (const auto preset : {FlowPreset::kFast, FlowPreset::kMedium, FlowPreset::kFine}) {
    const auto f = compute_flow(ref, other, preset);
    std::cout << "  clean " << test::median_end_point_error(f, truth, 16) << " noisy "
              << test::median_end_point_error(compute_flow(test::noisy(ref, 0.2, 1), test::noisy(other, 0.2, 2), preset), truth, 16)
              << " psnr " << test::psnr(ref, other, 16) << " -> " << test::psnr(ref, warp(other, f), 16) << " truth " << test::psnr(ref, warp(other, truth), 16);
  }
  std::cout << "\n";
}

}  // namespace lightstage::align
