// The optimiser against torch's.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <torch/torch.h>
#pragma pop_macro("CHECK")

#include <stdexcept>

#include "core/parallel.h"
#include "model/net/adam.h"

namespace lightstage {
namespace {

using torch::Tensor;
using torch::optim::AdamOptions;

// Of a convolution, a bias, and a single number; the first in the order of memory that the network's own weights may have.
std::vector<Tensor> parameters() {
  torch::manual_seed(3);
  return {torch::randn({24, 17, 3, 3}).contiguous(at::MemoryFormat::ChannelsLast).set_requires_grad(true),
          torch::randn({100003}).set_requires_grad(true), torch::randn({1}).set_requires_grad(true)};
}

// 20 steps, gradients of very different sizes; the bias has none in the first ones, and once gradients come in another order of memory.
std::vector<Tensor> after_steps(torch::optim::Adam& optimiser, const std::vector<Tensor>& values) {
  torch::manual_seed(4);
  for (int step = 0; step < 20; ++step) {
    for (Tensor value : values) {
      const Tensor gradient = torch::randn(value.sizes()) * std::pow(10, step % 7 - 6);
      value.mutable_grad() = step == 9 ? gradient : torch::empty_like(value).copy_(gradient);
    }
    if (step < 4) Tensor(values[1]).mutable_grad().reset();
    optimiser.step();
  }
  return values;
}

TEST_CASE("Adam in one pass takes torch's steps") {
  const double rate = GENERATE(1e-3, 0.1), epsilon = GENERATE(1e-8, 1e-3);
  const auto plain = parameters(), fast = parameters();
  torch::optim::Adam torch_adam(plain, AdamOptions(rate).eps(epsilon));
  model::OnePassAdam one_pass(fast, AdamOptions(rate).eps(epsilon));
  after_steps(torch_adam, plain);
  after_steps(one_pass, fast);
  for (std::size_t i = 0; i < plain.size(); ++i) {
    CHECK((plain[i] - fast[i]).abs().max().item<double>() < 2e-3 * rate);
    CHECK((parameters()[i] - fast[i]).abs().max().item<double>() > 0.1 * rate);  // it has moved
    const auto state_of = [](const torch::optim::Adam& optimiser, const Tensor& value) {
      return static_cast<torch::optim::AdamParamState&>(
          *optimiser.state().at(c10::guts::to_string(value.unsafeGetTensorImpl())));
    };
    CHECK(state_of(torch_adam, plain[i]).step() == state_of(one_pass, fast[i]).step());
    CHECK(torch::allclose(state_of(torch_adam, plain[i]).exp_avg(), state_of(one_pass, fast[i]).exp_avg(), 1e-4, 1e-6));
    CHECK(torch::allclose(state_of(torch_adam, plain[i]).exp_avg_sq(), state_of(one_pass, fast[i]).exp_avg_sq(), 1e-4,
                          1e-12));
  }
}

TEST_CASE("Adam in one pass is the same for every thread count") {
  std::vector<std::vector<Tensor>> results;
  for (const int threads : {1, 2, 5}) {
    at::set_num_threads(threads);
    results.push_back(parameters());
    model::OnePassAdam optimiser(results.back(), AdamOptions(1e-2));
    after_steps(optimiser, results.back());
  }
  at::set_num_threads(core::thread_count());
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(results[0][i].equal(results[1][i]));
    CHECK(results[0][i].equal(results[2][i]));
  }
}

TEST_CASE("what Adam in one pass does not know is refused") {
  const auto values = parameters();
  for (const AdamOptions& options : {AdamOptions().weight_decay(0.1), AdamOptions().amsgrad(true)}) {
    model::OnePassAdam optimiser(values, options);
    CHECK_THROWS_AS(optimiser.step(), std::logic_error);
  }
  model::OnePassAdam optimiser(values);
  CHECK_THROWS_AS(optimiser.step([] { return Tensor(); }), std::logic_error);
}

}  // namespace
}  // namespace lightstage
