// The loops of model/net/norm_prelu.h over pixels of interleaved channels, compiled once for each instruction set like the kernels.
#pragma once

#include <cstddef>
#include <cstdint>

namespace lightstage::model {

// prelu(gain x + offset) by channel.
struct ChannelAffine {
  const float* gain;
  const float* offset;
  const float* slope;
};

struct ChannelLoops {
  // sums[c] += x, sums[channels + c] += x^2
  void (*add_moments)(const float* x, std::int64_t pixels, std::int64_t channels, double* sums);
  void (*apply)(const float* x, std::int64_t pixels, std::int64_t channels, const ChannelAffine& affine, float* y);
  // With z = gain x + offset and dz the gradient before the PReLU: sums[c] += dz, sums[channels + c] += dz x,
  // sums[2 channels + c] += dy min(z, 0)
  void (*add_gradients)(const float* x, const float* dy, std::int64_t pixels, std::int64_t channels,
                        const ChannelAffine& affine, double* sums);
  // dx = gain dz + tilt x + level
  void (*gradient)(const float* x, const float* dy, std::int64_t pixels, std::int64_t channels,
                   const ChannelAffine& affine, const float* tilt, const float* level, float* dx);
};

// The fastest that this processor runs.
const ChannelLoops& channel_loops();

}  // namespace lightstage::model
