// The loops behind model/engine/channel_loops.h; included like model/engine/kernel_loops.h, and as careful.
#pragma once

#include "model/engine/channel_loops.h"

namespace lightstage::model {
namespace {

void add_moments(const float* __restrict x, std::int64_t pixels, std::int64_t channels, double* __restrict sums) {
  double* __restrict squares = sums + channels;
  for (std::int64_t p = 0; p < pixels; ++p, x += channels) {
    for (std::int64_t c = 0; c < channels; ++c) {
      const double value = x[c];
      sums[c] += value;
      squares[c] += value * value;
    }
  }
}

void apply_affine(const float* __restrict x, std::int64_t pixels, std::int64_t channels, const ChannelAffine& affine,
                  float* __restrict y) {
  const float* __restrict gain = affine.gain;
  const float* __restrict offset = affine.offset;
  const float* __restrict slope = affine.slope;
  for (std::int64_t p = 0; p < pixels; ++p, x += channels, y += channels) {
    for (std::int64_t c = 0; c < channels; ++c) {
      const float z = gain[c] * x[c] + offset[c];
      y[c] = z > 0 ? z : slope[c] * z;
    }
  }
}

void add_gradients(const float* __restrict x, const float* __restrict dy, std::int64_t pixels, std::int64_t channels,
                   const ChannelAffine& affine, double* __restrict sums) {
  const float* __restrict gain = affine.gain;
  const float* __restrict offset = affine.offset;
  const float* __restrict slope = affine.slope;
  double* __restrict products = sums + channels;
  double* __restrict slopes = sums + 2 * channels;
  for (std::int64_t p = 0; p < pixels; ++p, x += channels, dy += channels) {
    for (std::int64_t c = 0; c < channels; ++c) {
      const float z = gain[c] * x[c] + offset[c];
      const float dz = dy[c] * (z > 0 ? 1.f : slope[c]);
      sums[c] += double(dz);
      products[c] += double(dz) * double(x[c]);
      slopes[c] += double(dy[c]) * double(z > 0 ? 0.f : z);
    }
  }
}

void gradient(const float* __restrict x, const float* __restrict dy, std::int64_t pixels, std::int64_t channels,
              const ChannelAffine& affine, const float* __restrict tilt, const float* __restrict level,
              float* __restrict dx) {
  const float* __restrict gain = affine.gain;
  const float* __restrict offset = affine.offset;
  const float* __restrict slope = affine.slope;
  for (std::int64_t p = 0; p < pixels; ++p, x += channels, dy += channels, dx += channels) {
    for (std::int64_t c = 0; c < channels; ++c) {
      const float z = gain[c] * x[c] + offset[c];
      const float dz = dy[c] * (z > 0 ? 1.f : slope[c]);
      dx[c] = gain[c] * dz + tilt[c] * x[c] + level[c];
    }
  }
}

constexpr ChannelLoops make_channel_loops() {
  return {add_moments, apply_affine, add_gradients, gradient};
}

}  // namespace
}  // namespace lightstage::model
