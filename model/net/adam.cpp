#include "model/net/adam.h"

#include <ATen/Parallel.h>

#include <cmath>
#include <stdexcept>

namespace lightstage::model {
namespace {

using torch::Tensor;
using torch::optim::AdamOptions;
using torch::optim::AdamParamState;

constexpr std::int64_t kGrain = 1 << 16;

struct Factors {
  float keep_mean, add_mean, keep_square, add_square;
  float step, square_correction, epsilon;
};

Factors factors(const AdamOptions& options, std::int64_t step) {
  const auto [beta1, beta2] = options.betas();
  const double n = double(step);
  // 1 - beta^n: by expm1, since beta2 is near 1.
  const double mean_correction = -std::expm1(n * std::log(beta1)), square_correction = -std::expm1(n * std::log(beta2));
  return {float(beta1),
          float(1 - beta1),
          float(beta2),
          float(1 - beta2),
          float(options.lr() / mean_correction),
          float(1 / std::sqrt(square_correction)),
          float(options.eps())};
}

void update(float* __restrict value, const float* __restrict gradient, float* __restrict mean, float* __restrict square,
            std::int64_t count, const Factors& f) {
  for (std::int64_t i = 0; i < count; ++i) {
    const float g = gradient[i];
    mean[i] = f.keep_mean * mean[i] + f.add_mean * g;
    square[i] = f.keep_square * square[i] + f.add_square * g * g;
    value[i] -= f.step * mean[i] / (std::sqrt(square[i]) * f.square_correction + f.epsilon);
  }
}

// The tensor, or a copy of it whose numbers lie in memory as those of `like`.
Tensor laid_out_as(const Tensor& like, const Tensor& tensor) {
  return tensor.strides() == like.strides() ? tensor : torch::empty_like(like).copy_(tensor);
}

}  // namespace

Tensor OnePassAdam::step(LossClosure closure) {
  if (closure) throw std::logic_error("OnePassAdam takes no closure");
  const torch::NoGradGuard no_gradients;
  for (const auto& group : param_groups()) {
    const auto& options = static_cast<const AdamOptions&>(group.options());
    if (options.weight_decay() != 0 || options.amsgrad()) throw std::logic_error("OnePassAdam is plain Adam");
    for (const Tensor& parameter : group.params()) {
      if (!parameter.grad().defined()) continue;
      auto& slot = state_[c10::guts::to_string(parameter.unsafeGetTensorImpl())];
      if (slot == nullptr) {
        auto fresh = std::make_unique<AdamParamState>();
        fresh->step(0);
        fresh->exp_avg(torch::zeros_like(parameter));
        fresh->exp_avg_sq(torch::zeros_like(parameter));
        slot = std::move(fresh);
      }
      auto& state = static_cast<AdamParamState&>(*slot);
      state.step(state.step() + 1);
      state.exp_avg(laid_out_as(parameter, state.exp_avg()));
      state.exp_avg_sq(laid_out_as(parameter, state.exp_avg_sq()));
      const Tensor gradient = laid_out_as(parameter, parameter.grad());
      float* const value = parameter.data_ptr<float>();
      const float* const slope = gradient.data_ptr<float>();
      float* const mean = state.exp_avg().data_ptr<float>();
      float* const square = state.exp_avg_sq().data_ptr<float>();
      const Factors f = factors(options, state.step());
      at::parallel_for(0, parameter.numel(), kGrain, [&](std::int64_t first, std::int64_t last) {
        update(value + first, slope + first, mean + first, square + first, last - first, f);
      });
    }
  }
  return {};
}

}  // namespace lightstage::model
