// The lights' frames in the common pose, on their way into the store.
#pragma once

#include <filesystem>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "db/store.h"

namespace lightstage::cli {

// Stores frames as they come. One in which part of the subject is hidden (align/hidden.h) waits in a file of its own until all have come, and
// what it hides is then predicted from the frames of the lights around its own. Memory does not grow with the number of frames.
class AlignedFrames {
 public:
  // `lights`: where each light of the stage is, about. `mask`: the subject; empty: everywhere.
  AlignedFrames(db::Store& store, std::vector<core::Direction> lights, core::Image mask);
  ~AlignedFrames();
  AlignedFrames(const AlignedFrames&) = delete;
  AlignedFrames& operator=(const AlignedFrames&) = delete;

  // A frame that is to be used, with its confidence.
  void keep(const db::Step& step, core::ImageView picture, core::ImageView confidence);

  struct Stored {
    int step_index = 0;
    db::ContentHash picture, confidence;
  };
  // All that were kept, in that order. What is hidden and shown by no light around is 0 there, and in `seen`. `at_a_time`: how many frames are worked on at once.
  std::vector<Stored> finish(core::Image& seen, std::size_t at_a_time);

  // Of the subject, mean over the frames kept.
  double hidden_share() const { return frames_.empty() ? 0 : hidden_ / double(frames_.size()); }

 private:
  struct Frame {
    Stored stored;
    int light_index = 0;
    std::int64_t exposure_ns = 0;
    std::filesystem::path waiting;  // empty: it is stored
  };
  const core::Direction& light_of(const Frame& frame) const { return lights_.at(std::size_t(frame.light_index)); }
  core::Image picture_of(const Frame& frame) const;
  std::vector<std::size_t> beside(std::size_t frame) const;
  core::Image filled(std::size_t frame, core::Image& seen) const;

  db::Store& store_;
  std::vector<core::Direction> lights_;
  core::Image mask_;
  std::filesystem::path folder_;  // of frames that wait; made when it is needed
  std::vector<Frame> frames_;
  double hidden_ = 0;
};

}  // namespace lightstage::cli
