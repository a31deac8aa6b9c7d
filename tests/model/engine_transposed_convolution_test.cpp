// The fast transposed convolution against torch's own.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <torch/torch.h>
#pragma pop_macro("CHECK")

#include "model/net/transposed_convolution.h"

namespace lightstage {
namespace {

using torch::Tensor;

double largest_difference(const Tensor& a, const Tensor& b) {
  REQUIRE(a.sizes() == b.sizes());
  return (a - b).abs().max().item<double>();
}

TEST_CASE("the doubling convolution and its gradients are those of conv_transpose2d") {
  struct Shape {
    int images, in, out, height, width;
  };
  const auto s = GENERATE(
      values<Shape>({{1, 4, 4, 1, 1}, {1, 12, 8, 3, 5}, {2, 16, 4, 7, 1}, {1, 64, 32, 13, 17}, {3, 20, 24, 2, 11}}));
  torch::manual_seed(5);
  const auto tracked = [](Tensor t) { return t.set_requires_grad(true); };
  const Tensor x = tracked(torch::randn({s.images, s.in, s.height, s.width}));
  const Tensor weight = tracked(torch::randn({s.in, s.out, 3, 3}));
  const Tensor bias = tracked(torch::randn({s.out}));
  const Tensor up = torch::randn({s.images, s.out, 2 * s.height, 2 * s.width});

  const Tensor fast = model::doubling_convolution(x, weight, bias);
  const Tensor plain = torch::conv_transpose2d(x, weight, bias, /*stride=*/2, /*padding=*/1, /*output_padding=*/1);
  REQUIRE(largest_difference(fast, plain) < 1e-4);

  const auto gradients = torch::autograd::grad({fast}, {x, weight, bias}, {up});
  const auto expected = torch::autograd::grad({plain}, {x, weight, bias}, {up});
  for (std::size_t i = 0; i < expected.size(); ++i) {
    REQUIRE(largest_difference(gradients[i], expected[i]) < 1e-4 * (1 + expected[i].abs().max().item<double>()));
  }
}

TEST_CASE("the doubling convolution computes only the gradients that are wanted") {
  const Tensor x = torch::randn({1, 4, 3, 3});
  const Tensor weight = torch::randn({4, 4, 3, 3}).set_requires_grad(true);
  const Tensor bias = torch::zeros({4});
  const Tensor y = model::doubling_convolution(x, weight, bias);
  y.sum().backward();
  REQUIRE(weight.grad().defined());
  REQUIRE(weight.grad().abs().sum().item<double>() > 0);
  REQUIRE(!x.grad().defined());
}

}  // namespace
}  // namespace lightstage
