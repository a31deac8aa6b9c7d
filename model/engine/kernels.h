// The inner loops of the engine, compiled once for each instruction set and chosen at run time.
//
// Feature maps are rows of blocks of pixels of 16 channels, [row][channel block][pixel][16]: what a convolution reads for neighbouring
// pixels is contiguous, one row is what the next layer consumes at a time, and a channel is always in the same lane. Channels that
// fill up the last block are zero.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace lightstage::model {

inline constexpr int kLanes = 16;
inline constexpr int kWidestRun = 14;

// How numbers are kept: as float32; as its upper half (8 bits of precision, the same range), for products; or as IEEE 754 half precision (11 bits,
// up to 65504, where larger ones stop), for storage.
enum class Number { kFloat32, kBfloat16, kFloat16 };
using Bfloat16 = std::uint16_t;
enum class Float16 : std::uint16_t {};  // the bits

constexpr std::size_t size_of(Number number) {
  return number == Number::kFloat32 ? 4 : 2;
}

// Sums over the outputs of a convolution, by lane of up to two blocks, relative to a pivot (the first output of each channel) so that the
// variance of a nearly constant map does not drown in its mean.
struct Moments {
  double count = 0;  // outputs a channel; the pivot is set while it is 0
  alignas(64) float pivot[2 * kLanes];
  alignas(64) double sum[2 * kLanes] = {};
  alignas(64) double squares[2 * kLanes] = {};
};

// A run of neighbouring output pixels, of one or two blocks of output channels:
// output[o][p] = bias[o] + sum over input blocks b, taps t and channels c of weights[b][t][c][o] taps[t][b][p * stride][c].
struct ConvolutionRun {
  const void* taps[9];  // for each tap the input of output pixel 0, block 0
  int tap_count;
  int input_blocks;
  std::size_t input_block_bytes;
  int words;            // 32-bit words of a block that count: a float32 channel, or two bfloat16 ones
  const void* weights;  // 64-byte aligned, contiguous in the order of the sum; a word holds what meets an input word
  const float* bias;
  float* output;  // 64-byte aligned
  std::size_t output_block_bytes;
  std::size_t output_pixel_bytes;
  bool past_caches;  // for maps that the caches cannot hold until they are read; fence before another thread reads them
  Moments* moments;  // the run is added to them
};

// y = prelu(gain x + offset), by lane of one block.
struct BlockAffine {
  alignas(64) float gain[kLanes];
  alignas(64) float offset[kLanes];
  alignas(64) float slope[kLanes];
};

// Three rows of the last feature map, each with a pixel more at both ends, to a row of the picture by a 3x3 convolution and a sigmoid.
struct PictureRow {
  const float* rows[3];  // pixel -1 of block 0; reaches to a multiple of 8 pixels and one more
  std::size_t block_floats;
  int blocks;
  const float* weights;  // [ky][block][kx][output][16]
  const float* bias;     // [3]
  int width;
  float* rgb;  // [width][3]
};

// Of one instruction set and one number format, N.
struct Kernels {
  const char* name;
  Number number;
  // Runs take N and give float32; [stride - 1][blocks - 1][pixels - 1] for up to `widest_run` pixels.
  int widest_run;
  void (*convolve[2][2][kWidestRun])(const ConvolutionRun& run);
  // Pixels of one block; to N, or to float32.
  void (*normalise)(const float* in, void* out, std::size_t pixels, const BlockAffine& affine);
  void (*normalise_to_float)(const float* in, float* out, std::size_t pixels, const BlockAffine& affine);
  // sum of weights[i] in[i] over `count`, of blocks of 16 numbers; to N, from float32 or from float16. `out` may be one of `in`.
  void (*pool_float)(const void* const* in, const float* weights, int count, void* out, std::size_t blocks);
  void (*pool_float16)(const void* const* in, const float* weights, int count, void* out, std::size_t blocks);
  void (*picture)(const PictureRow& row);
  // float32 to float16, to the nearest, ties to even.
  void (*shorten)(const float* in, Float16* out, std::size_t blocks);
};

// The fastest float32 kernels that this processor runs.
const Kernels& float_kernels();
// With bfloat16 products summed in float32; null where the processor has no instructions for them.
const Kernels* bfloat_kernels();
// All float32 kernels that this processor runs, for tests.
std::span<const Kernels* const> all_float_kernels();

}  // namespace lightstage::model
