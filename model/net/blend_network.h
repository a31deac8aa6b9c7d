// The network that chooses among captured pixels (docs/model.md draws it and tells what was tried).
//
// It starts from the guide, the thin-plate picture, and corrects it: at every pixel the captured neighbours compete with the guide for a share
// of the result, and a small residual is added. Everything that is summed over the active set is weighted by the alias-free W_i (Sun et al.
// 2020, section 4.2), so the result is continuous in the query.
#pragma once

#include "model/net/network.h"

namespace lightstage::model {

class BlendNetwork : public Network {
 public:
  // Starts close to the guide: neighbours have e^-4 of its share, the residual is 0.
  BlendNetwork(const NetworkConfig& config, std::uint64_t seed);

  int size_multiple() const override { return 1 << (config().channels.size() - 1); }

  // R + sum_i a_i (I_i - R) + residual, with a_i = k W_i exp(g_i) / (1 + sum_j k W_j exp(g_j)) and logits g_i within +-kLogitBound.
  torch::Tensor predict(const torch::Tensor& images, const torch::Tensor& guide, const ActiveSet& set) const override {
    return predict(images, guide, set, 1);
  }

  // The same for large pictures: logits and residual are computed on pictures averaged down by `coarseness` and enlarged bilinearly; the pixels
  // that are chosen among keep their full size. Heights and widths must be multiples of size_multiple() * coarseness.
  torch::Tensor predict(const torch::Tensor& images, const torch::Tensor& guide, const ActiveSet& set,
                        int coarseness) const;

  // At least 1: brings a subject whose mask is so many pixels high or wide to about the size that subjects had in training, at which shadows
  // move as far from light to light as the network has learnt to look.
  static int coarseness(int longest_side);

  static constexpr double kLogitBound = 8;

 private:
  struct Correction {
    torch::Tensor logits;    // [k, 1, h, w]
    torch::Tensor residual;  // [1, 3, h, w]
  };
  Correction correction(const torch::Tensor& images, const torch::Tensor& guide, const ActiveSet& set) const;
};

}  // namespace lightstage::model
