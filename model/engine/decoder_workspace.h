// The memory that decoding a picture takes.
#pragma once

#include <cstddef>
#include <cstring>
#include <mutex>
#include <utility>
#include <vector>

#include "model/engine/feature_map.h"
#include "model/engine/kernels.h"

namespace lightstage::model {

// What decoding one picture writes to.
struct DecoderWorkspace {
  int height = 0, width = 0;                     // of the picture
  bool frugal = false;                           // maps exist only while they are needed, and that of level 0 never
  std::vector<FeatureMap> outputs;               // of the convolutions, by level
  std::vector<FeatureMap> inputs;                // by level, where there is more than one pair of output blocks
  std::vector<std::vector<Moments>> moments;     // by level: by pair and part
  std::vector<std::vector<BlockAffine>> affine;  // by level, for its output
  std::vector<float> query;

  void begin_level(std::size_t level) {
    if (inputs[level].height() > 0) inputs[level].allocate();
    if (!(frugal && level == 0)) outputs[level].allocate();
  }
  // Of those that level `level` has read.
  void end_level(std::size_t level) {
    if (!frugal) return;
    inputs[level].release();
    if (level + 1 < outputs.size()) outputs[level + 1].release();
  }

  // A thread's rows.
  std::size_t scratch_bytes = 0;
  std::mutex mutex;
  std::vector<Pages> idle_scratch;

  Pages take_scratch() {
    {
      const std::lock_guard lock(mutex);
      if (!idle_scratch.empty()) {
        Pages scratch = std::move(idle_scratch.back());
        idle_scratch.pop_back();
        return scratch;
      }
    }
    return Pages(scratch_bytes);
  }
  void give_scratch(Pages scratch) {
    const std::lock_guard lock(mutex);
    idle_scratch.push_back(std::move(scratch));
  }
};

// Of the rows that a task on one level computes with.
struct DecoderRowShape {
  int picture_width, width;  // of the picture, and of the level's input
  int input_blocks, output_blocks, picture_blocks;
  Number number;  // of the input

  std::size_t input_block_bytes() const { return std::size_t(width + 1) * kLanes * size_of(number); }
  std::size_t input_bytes() const { return input_block_bytes() * std::size_t(input_blocks); }
  std::size_t output_block_bytes() const { return std::size_t(2 * width) * kLanes * sizeof(float); }
  std::size_t output_bytes() const { return output_block_bytes() * std::size_t(output_blocks); }
  // The picture kernel reads a pixel more at both ends of whole steps.
  std::size_t picture_block_floats() const {
    return std::size_t((picture_width + kPictureStep - 1) / kPictureStep * kPictureStep + 2) * kLanes;
  }
  std::size_t picture_bytes() const { return picture_block_floats() * std::size_t(picture_blocks) * sizeof(float); }
  std::size_t bytes() const { return 2 * input_bytes() + 2 * output_bytes() + 5 * picture_bytes(); }

  static constexpr int kPictureStep = 8;
};

// The rows themselves: two of input, two of output, and five for the picture.
class DecoderRows {
 public:
  DecoderRows(DecoderWorkspace& space, const DecoderRowShape& shape)
      : space_(space), shape_(shape), scratch_(space.take_scratch()) {}
  ~DecoderRows() { space_.give_scratch(std::move(scratch_)); }
  DecoderRows(const DecoderRows&) = delete;
  DecoderRows& operator=(const DecoderRows&) = delete;

  Row input(int y) const {
    return {scratch_.data() + std::size_t(y % 2) * shape_.input_bytes(), shape_.input_block_bytes()};
  }
  Row no_input(int y) const {
    const Row row = input(y);
    std::memset(row.data, 0, shape_.input_bytes());
    return row;
  }
  Row output(int parity) const {
    return {scratch_.data() + 2 * shape_.input_bytes() + std::size_t(parity) * shape_.output_bytes(),
            shape_.output_block_bytes()};
  }
  // Pixel -1 of block 0.
  float* picture(int y) const { return picture_row(std::size_t(y % 4)); }
  float* no_picture() const {
    std::memset(picture_row(4), 0, shape_.picture_bytes());
    return picture_row(4);
  }
  const DecoderRowShape& shape() const { return shape_; }

 private:
  float* picture_row(std::size_t n) const {
    return reinterpret_cast<float*>(scratch_.data() + 2 * shape_.input_bytes() + 2 * shape_.output_bytes() +
                                    n * shape_.picture_bytes());
  }

  DecoderWorkspace& space_;
  DecoderRowShape shape_;
  Pages scratch_;
};

}  // namespace lightstage::model
