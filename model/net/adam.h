// Adam in one pass over memory.
#pragma once

#include <torch/torch.h>

namespace lightstage::model {

// torch::optim::Adam (Kingma and Ba 2015, "Adam: a method for stochastic optimization", algorithm 1) with the same state and, to float32 rounding,
// the same steps; torch makes one pass over parameters and moments for every operation in them. Without weight decay and AMSGrad, which throw
// std::logic_error. Does not depend on the thread count.
class OnePassAdam : public torch::optim::Adam {
 public:
  using Adam::Adam;

  torch::Tensor step(LossClosure closure = nullptr) override;
};

}  // namespace lightstage::model
