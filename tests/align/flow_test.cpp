#include "align/flow.h"

#include <catch2/catch.hpp>
#include <limits>
#include <opencv2/core.hpp>

#include "align/moving_pictures.h"
#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::align {

namespace {

constexpr int kBorder = 16;

test::Motion shift_by(double dx, double dy) {
  return [=](double, double) { return std::pair{dx, dy}; };
}

double largest_length(const FlowField& flow) {
  double largest = 0;
  for (int y = 0; y < flow.height(); ++y) {
    for (int x = 0; x < flow.width(); ++x) {
      largest = std::max(largest, std::hypot(double(flow(y, x, 0)), double(flow(y, x, 1))));
    }
  }
  return largest;
}

}  // namespace

TEST_CASE("shifts from a tenth of a pixel to eight are found, clean and noisy") {
  const test::Texture texture(7);
  const core::Image reference = test::picture_of(texture, 256, 256);
  for (const double shift : {0.1, 0.5, 1.3, 3.7, 8.0}) {
    const test::Motion motion = shift_by(shift, -0.6 * shift);
    const core::Image other = test::moved_picture_of(texture, 256, 256, motion);
    const FlowField truth = test::flow_of(motion, 256, 256);
    INFO("shift " << shift);
    CHECK(test::median_end_point_error(compute_flow(reference, other), truth, kBorder) < 0.02);
    const core::Image noisy_reference = test::noisy(reference, 0.2, 1);
    const core::Image noisy_other = test::noisy(other, 0.2, 2);
    CHECK(test::median_end_point_error(compute_flow(noisy_reference, noisy_other), truth, kBorder) < 0.03);
    CHECK(test::median_end_point_error(compute_flow(noisy_reference, noisy_other, FlowPreset::kDisMedium), truth,
                                       kBorder) < 0.1);
    CHECK(test::median_end_point_error(compute_flow(noisy_reference, noisy_other, FlowPreset::kDisFast), truth,
                                       kBorder) < 0.25);
  }
}

TEST_CASE("a subject that stands still does not move") {
  const core::Image picture = test::picture_of(test::Texture(7), 256, 256);
  CHECK(largest_length(compute_flow(picture, picture)) == 0);
  const FlowField still(256, 256, 2);
  CHECK(test::median_end_point_error(compute_flow(test::noisy(picture, 0.5, 1), test::noisy(picture, 0.5, 2)), still,
                                     kBorder) < 0.02);
}

TEST_CASE("a motion that varies over the picture is found, and warping by it brings the picture back") {
  const test::Motion motion = [](double x, double y) {
    return std::pair{3 * std::sin(x / 40) + 0.02 * y, 2.5 * std::cos(y / 50) - 0.01 * x};
  };
  const test::Texture texture(7);
  const core::Image reference = test::picture_of(texture, 256, 256);
  const core::Image other = test::moved_picture_of(texture, 256, 256, motion);
  const FlowField truth = test::flow_of(motion, 256, 256);
  const FlowField clean = compute_flow(reference, other);
  CHECK(test::median_end_point_error(clean, truth, kBorder) < 0.05);
  CHECK(test::psnr(reference, other, kBorder) < 20);
  CHECK(test::psnr(reference, warp(other, clean), kBorder) > 48);
  CHECK(test::psnr(reference, warp(other, truth), kBorder) > 55);
  const FlowField noisy = compute_flow(test::noisy(reference, 0.2, 1), test::noisy(other, 0.2, 2));
  CHECK(test::median_end_point_error(noisy, truth, kBorder) < 0.09);
}

TEST_CASE("flow does not depend on units, channels or row stride") {
  const test::Texture texture(9);
  const core::Image reference = test::picture_of(texture, 64, 80);
  const core::Image other = test::moved_picture_of(texture, 64, 80, shift_by(1, 2));
  const FlowField flow = compute_flow(reference, other);
  const FlowField rgb = compute_flow(core::to_rgb(reference), core::to_rgb(other));
  CHECK(test::median_end_point_error(flow, rgb, 0) < 1e-4);
  core::Image bright_reference = reference, bright_other = other;
  for (float& v : bright_reference.values()) v *= 1024;
  for (float& v : bright_other.values()) v *= 1024;
  CHECK(compute_flow(bright_reference, bright_other) == flow);
  core::Image wide_reference(70, 100, 1), wide_other(70, 100, 1);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 80; ++x) {
      wide_reference(y + 3, x + 11) = reference(y, x);
      wide_other(y + 3, x + 11) = other(y, x);
    }
  }
  CHECK(compute_flow(wide_reference.view().crop(3, 11, 64, 80), wide_other.view().crop(3, 11, 64, 80)) == flow);
}

TEST_CASE("pictures without texture give finite flow, even ones none") {
  core::Image even(40, 50, 3);
  CHECK(largest_length(compute_flow(even, even)) == 0);
  core::Image brighter = even;
  for (float& v : brighter.values()) v = 0.5F;
  CHECK(largest_length(compute_flow(even, brighter)) < 100);
  CHECK(largest_length(compute_flow(brighter, brighter)) == 0);
  core::Image negative = even;
  for (float& v : negative.values()) v = -0.3F;
  CHECK(largest_length(compute_flow(negative, negative)) == 0);
  core::Image hot = even;
  hot(20, 20, 1) = 1e5F;
  CHECK(largest_length(compute_flow(hot, hot)) == 0);
  CHECK(largest_length(compute_flow(hot, even)) < 100);
  const core::Image noise_a = test::noisy(core::Image(61, 67, 1), 1, 1);
  const core::Image noise_b = test::noisy(core::Image(61, 67, 1), 1, 2);
  CHECK(largest_length(compute_flow(noise_a, noise_b)) < 100);
}

TEST_CASE("small and odd sizes work") {
  const test::Texture texture(9);
  for (const auto& [height, width] : {std::pair{16, 16}, {17, 31}, {16, 211}, {127, 19}, {101, 103}}) {
    const FlowField flow = compute_flow(test::picture_of(texture, height, width),
                                        test::moved_picture_of(texture, height, width, shift_by(0.5, 0.25)));
    INFO(height << " x " << width);
    CHECK(flow.size() == core::ImageSize{height, width, 2});
    CHECK(test::median_end_point_error(flow, test::flow_of(shift_by(0.5, 0.25), height, width), 4) < 0.1);
    for (const FlowPreset preset : {FlowPreset::kDisFast, FlowPreset::kDisMedium}) {
      CHECK(compute_flow(core::Image(height, width, 1), core::Image(height, width, 1), preset).width() == width);
    }
  }
}

TEST_CASE("flow does not depend on the number of threads") {
  const test::Texture texture(11);
  const core::Image reference = test::noisy(test::picture_of(texture, 151, 139), 0.2, 1);
  const core::Image other = test::noisy(test::moved_picture_of(texture, 151, 139, shift_by(2, -3)), 0.2, 2);
  const int threads = cv::getNumThreads();
  for (const FlowPreset preset : {FlowPreset::kDisFast, FlowPreset::kDisMedium, FlowPreset::kFine}) {
    cv::setNumThreads(1);
    const FlowField one = compute_flow(reference, other, preset);
    cv::setNumThreads(3);
    const FlowField three = compute_flow(reference, other, preset);
    cv::setNumThreads(8);
    const FlowField eight = compute_flow(reference, other, preset);
    CHECK(one == three);
    CHECK(one == eight);
  }
  cv::setNumThreads(threads);
}

TEST_CASE("every method finds a smooth motion, at every working size, on any number of threads") {
  const test::Motion motion = [](double x, double y) {
    return std::pair{2 * std::sin(x / 45) + 0.01 * y, 2 * std::cos(y / 50) - 0.01 * x};
  };
  const test::Texture texture(7);
  const int height = 151, width = 167;
  const core::Image reference = test::noisy(test::picture_of(texture, height, width), 0.2, 1);
  const core::Image other = test::noisy(test::moved_picture_of(texture, height, width, motion), 0.2, 2);
  const FlowField truth = test::flow_of(motion, height, width);
  const int threads = cv::getNumThreads();
  for (const auto& [name, preset] : kFlowPresets) {
    INFO(name);
    CHECK(name_of(preset) == name);
    cv::setNumThreads(1);
    const FlowField flow = compute_flow(reference, other, preset);
    CHECK(test::median_end_point_error(flow, truth, kBorder) < 0.3);
    cv::setNumThreads(3);
    CHECK(compute_flow(reference, other, preset) == flow);
    cv::setNumThreads(threads);
    CHECK(test::median_end_point_error(compute_flow(reference, other, preset, 2), truth, kBorder) < 0.4);
    const core::Image tiny(17, 16, 1), even(40, 57, 3);
    CHECK(largest_length(compute_flow(tiny, tiny, preset)) == 0);
    CHECK(largest_length(compute_flow(even, even, preset)) == 0);
  }
}

TEST_CASE("a working size below that of the picture keeps where things are") {
  const test::Texture texture(7);
  const core::Image reference = test::picture_of(texture, 256, 251);
  const test::Motion zoom = [](double x, double y) { return std::pair{0.02 * (x - 125), 0.02 * (y - 128)}; };
  const core::Image other = test::moved_picture_of(texture, 256, 251, zoom);
  for (const int shrink : {1, 2, 3}) {
    INFO(shrink);
    CHECK(test::median_end_point_error(compute_flow(reference, other, FlowPreset::kFine, shrink),
                                       test::flow_of(zoom, 256, 251), 24) < 0.03 * shrink);
  }
}

TEST_CASE("where flow there and back disagree, or leave the picture, it is not believed") {
  const int height = 30, width = 40;
  const FlowField there = test::flow_of(shift_by(5, 0), height, width);
  FlowField back = test::flow_of(shift_by(-5, 0), height, width);
  const core::Image sure = flow_confidence(there, back);
  CHECK(sure.size() == core::ImageSize{height, width, 1});
  CHECK(sure(10, 34) == 1);
  CHECK(sure(10, 35) == 0);  // leaves the picture
  CHECK(sure(0, 0) == 1);
  for (int y = 0; y < height; ++y) {
    back(y, 20, 0) = -7;     // 2 px off: beyond sqrt(0.01 * (25 + 49) + 0.5)
    back(y, 30, 0) = -5.5F;  // half a pixel off
  }
  const core::Image unsure = flow_confidence(there, back);
  CHECK(unsure(10, 15) == 0);
  CHECK(unsure(10, 25) == Approx(1 - 0.25 / (0.01 * (25 + 5.5 * 5.5) + 0.5)));
  CHECK(unsure(10, 20) == 1);
  CHECK(flow_confidence(FlowField(1, 1, 2), FlowField(1, 1, 2))(0, 0) == 1);
  CHECK_THROWS_AS(flow_confidence(there, FlowField(height, width + 1, 2)), core::BadInput);
  CHECK_THROWS_AS(flow_confidence(core::Image(3, 3, 1), core::Image(3, 3, 1)), core::BadInput);
  back(3, 3) = std::numeric_limits<float>::infinity();
  CHECK_THROWS_AS(flow_confidence(there, back), core::BadInput);
}

TEST_CASE("what a moving thing uncovers or covers is told by the flow there and back") {
  // A textured square moves 6 pixels to the right over a textured ground that stands still: what lies right of it is covered.
  const test::Texture ground(3), thing(8);
  const auto scene = [&](int at) {
    core::Image picture = test::picture_of(ground, 120, 160);
    for (int y = 40; y < 80; ++y)
      for (int x = at; x < at + 40; ++x) picture(y, x) = 2 * float(thing(x - at, y));
    return picture;
  };
  const core::Image first = scene(50), second = scene(56);
  const core::Image confidence = flow_confidence(compute_flow(first, second), compute_flow(second, first));
  double covered = 0, still = 0;
  for (int y = 45; y < 75; ++y) {
    for (int x = 91; x < 95; ++x) covered += double(confidence(y, x)) / (30 * 4);
    for (int x = 110; x < 150; ++x) still += double(confidence(y, x)) / (30 * 40);
  }
  INFO("covered " << covered << ", still " << still);
  CHECK(covered < 0.5);
  CHECK(still > 0.98);
}

TEST_CASE("pictures that cannot be compared are refused") {
  CHECK_THROWS_AS(compute_flow(core::Image(40, 40, 1), core::Image(40, 40, 1), FlowPreset::kFine, 3), core::BadInput);
  CHECK_THROWS_AS(compute_flow(core::Image(40, 40, 1), core::Image(40, 40, 1), FlowPreset::kFine, 0), core::BadInput);
  const core::Image picture(20, 20, 1);
  CHECK_THROWS_AS(compute_flow(picture, core::Image(20, 21, 1)), core::BadInput);
  CHECK_THROWS_AS(compute_flow(core::Image(15, 20, 1), core::Image(15, 20, 1)), core::BadInput);
  CHECK_THROWS_AS(compute_flow(core::Image(), core::Image()), core::BadInput);
  CHECK_THROWS_AS(compute_flow(core::Image(20, 20, 2), core::Image(20, 20, 2)), core::BadInput);
  core::Image bad = picture;
  bad(5, 6) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(compute_flow(bad, picture), core::BadInput);
  CHECK_THROWS_AS(compute_flow(picture, bad), core::BadInput);
}

}  // namespace lightstage::align
