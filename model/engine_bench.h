// How fast the published network runs here, measured.
#pragma once

#include <cstddef>
#include <optional>

#include "model/checkpoint.h"

namespace lightstage::model {

// Times are the best of several runs, all on core::thread_count() threads.
struct EngineBench {
  double gflop_per_query = 0;  // of decoding, 2 a multiply-add, 9 taps a transposed convolution
  double bytes_moved =
      0;  // by one query between memory and the processor at least: encodings, feature maps, weights, picture
  // One query: encode the active set, pool, decode, in plain libtorch; and the engine's, with all captured images encoded before.
  double straightforward_s = 0, engine_s = 0;
  double encode_s = 0;  // the engine's, one captured image
  // The fastest of torch's channels_last conv2d over shapes of the network's own layers.
  double roofline_gflops = 0;
  double max_abs_diff = 0;  // between the two pictures
  // Where the processor has bfloat16 products; encodings are kept in float16.
  std::optional<double> engine_bf16_s, max_abs_diff_bf16;
  double train_steps_per_s = 0, straightforward_train_steps_per_s = 0;  // on crops of `train_size` pixels square
  int train_size = 0;
  std::size_t peak_rss_bytes = 0;  // of the process up to the end of the engine's queries
};

// Pictures of `size` pixels square, weights and images at random (the same every time). Takes about half a minute for preset paper at
// 1024. Throws UsageError for a network that is not a superres, or a size that is no multiple of 2^levels.
EngineBench bench_engine(const NetworkConfig& config, int size);

}  // namespace lightstage::model
