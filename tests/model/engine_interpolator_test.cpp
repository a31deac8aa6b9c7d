// The engine behind the interface that the program uses: masks, borders, grey scans.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <torch/torch.h>
#pragma pop_macro("CHECK")

#include "core/display.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/engine/engine_interpolator.h"
#include "model/net/pixels.h"
#include "model/synthetic_scan.h"

namespace lightstage {
namespace {

using core::Image;
using torch::Tensor;

const model::NetworkConfig kConfig{.neighbours = 6, .channels = {8, 12, 16}, .query_channels = {8, 16}};

// Display-encoded, [k, 3, h, w].
Tensor displays(const core::OlatScan& scan, const std::vector<std::size_t>& lights) {
  std::vector<Tensor> images;
  for (const std::size_t light : lights) images.push_back(model::to_display(*scan.image(light), scan.exposure()));
  return torch::stack(images);
}

struct MaskedScan {
  int height, width, channels;
  int top, left, mask_height, mask_width;
};

TEST_CASE("inside the mask's box the picture is the network's, outside it is linear blending") {
  const auto m =
      GENERATE(values<MaskedScan>({{37, 53, 3, 5, 9, 21, 30},    // inside
                                   {37, 53, 1, 11, 20, 26, 33},  // up to the corner, so the window reaches out
                                   {16, 24, 3, 0, 0, 16, 24},    // everything
                                   {9, 7, 3, 4, 3, 1, 1}}));     // one pixel
  const int neighbours = GENERATE(1, 6, 16);
  CAPTURE(m.height, m.width, m.mask_height, neighbours);
  Image mask(m.height, m.width, 1);
  for (int y = 0; y < m.mask_height; ++y) {
    for (int x = 0; x < m.mask_width; ++x) mask(m.top + y, m.left + x) = 1;
  }
  const core::ImageSize size{m.height, m.width, m.channels};
  const std::vector<core::Direction> lights = core::fibonacci_directions(50);
  const auto glow = [](const core::Direction& light, int y, int x, int c) {
    return 0.3 + 0.25 * std::sin(0.4 * x + 3 * light.x()) * std::cos(0.3 * y + c + 2 * light.y());
  };
  const core::OlatScan scan = test::scan_of(lights, size, glow, mask);
  model::NetworkConfig config = kConfig;
  config.neighbours = neighbours;
  const model::SuperresNetwork network(config, 4);
  const auto interpolator = model::make_engine_interpolator(scan, network, {});
  CHECK(interpolator->name() == "superres");
  CHECK(interpolator->linear_weights(lights[3]).empty());

  for (const core::Direction& query : {core::Direction::from_vector({0.1, 0.5, 0.7}), lights[17]}) {
    const torch::NoGradGuard no_gradients;
    const model::ActiveSet set =
        network.active_set(query, lights, core::nearest_indices(lights, query, std::size_t(neighbours)),
                           core::median_spacing_radians(lights));
    const Tensor images = displays(scan, set.lights);
    const model::Window window =
        model::rounded_up({m.top, m.left, m.mask_height, m.mask_width}, network.size_multiple());
    Tensor expected = (images * set.weights.view({-1, 1, 1, 1})).sum(0, true);
    model::cut(expected, {m.top, m.left, m.mask_height, m.mask_width})
        .copy_(model::cut(network.predict(model::cut(images, window), {}, set), {0, 0, m.mask_height, m.mask_width}));
    const Image linear = model::from_display(expected, scan.exposure(), m.channels);

    core::set_thread_count(1);
    const Image picture = interpolator->render(query);
    REQUIRE(picture.size() == size);
    core::set_thread_count(3);
    CHECK(interpolator->render(query) == picture);
    core::set_thread_count(0);
    for (std::size_t i = 0; i < picture.values().size(); ++i) {
      REQUIRE(core::display_encode(picture.values()[i]) ==
              Approx(core::display_encode(linear.values()[i])).margin(1e-4));
    }
  }
}

TEST_CASE("the memory for images and encodings decides how often images are read, not the picture") {
  const core::ImageSize size{32, 24, 3};
  const std::vector<core::Direction> directions = core::fibonacci_directions(40);
  std::vector<core::Light> lights;
  for (const core::Direction& d : directions) lights.push_back({d, {}, {1, 1, 1}});
  Image mask(size.height, size.width, 1);
  for (int y = 4; y < 30; ++y) {
    for (int x = 3; x < 20; ++x) mask(y, x) = 1;
  }
  int reads = 0;
  const core::OlatScan scan("synthetic", lights, size, mask, [&](std::size_t light) {
    ++reads;
    return test::picture_of(size, directions[light], test::matt_ball(size));
  });
  const model::SuperresNetwork network(kConfig, 4);
  scan.exposure();

  std::vector<core::Direction> queries;
  for (int i = 0; i < 12; ++i) queries.push_back(core::Direction::from_vector({0.02 * i, 0.3, 0.8}));
  std::vector<Image> expected;
  const std::size_t image_bytes = size.value_count() * sizeof(float);
  const std::size_t encoding = model::encoding_bytes(kConfig.channels, {32, 24, 3}, model::Number::kFloat32);
  struct Case {
    std::size_t memory, spill;
    int fewest, most;  // reads of images
  };
  const std::size_t enough = 40 * (image_bytes + encoding), set = 6 * (image_bytes + encoding);
  for (const Case& c : {Case{enough, 0, 6, 40},  // every image once
                        Case{set, 0, 6, 40},     // the queries' lights hardly change
                        Case{set - 1, 0, 12 * 2 * 5, 12 * 2 * 6},
                        Case{0, 0, 12 * 2 * 5, 12 * 2 * 6},  // for its encoding, and for what is outside the mask
                        Case{0, std::size_t(1) << 30, 12 * 5, 12 * 6 + 40}}) {  // for what is outside the mask
    CAPTURE(c.memory, c.spill);
    const auto interpolator =
        model::make_engine_interpolator(scan, network, {.budget = {.memory_bytes = c.memory, .spill_bytes = c.spill}});
    reads = 0;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const Image picture = interpolator->render(queries[i]);
      if (expected.size() < queries.size()) {
        expected.push_back(picture);
      } else {
        for (std::size_t j = 0; j < picture.values().size(); ++j)
          REQUIRE(picture.values()[j] == Approx(expected[i].values()[j]).margin(1e-5));
      }
    }
    CHECK(reads >= c.fewest);
    CHECK(reads <= c.most);
  }
}

}  // namespace
}  // namespace lightstage
