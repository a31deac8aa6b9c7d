// What a picture does not show of the subject, from pictures under lights beside its own.
#pragma once

#include <cstdint>
#include <vector>

#include "core/direction.h"
#include "core/image.h"

namespace lightstage::align {

// From how many lights around a light what its picture hides is predicted, and how much each of them says: less the farther it is.
inline constexpr std::size_t kHiddenNeighbours = 6;
double hidden_weight(const core::Direction& light, const core::Direction& other);

// The pixels of a picture in the common pose that are hidden: inside the mask (> 0.5; empty: everywhere) with a confidence of 0 (align/flow.h).
// They are predicted from pictures in the same pose, handed over one at a time: their weighted mean, each first made as bright as this
// picture over what both show, channel by channel. All pictures of one size; confidence and mask have one channel. Takes memory for the hidden pixels alone.
class HiddenPixels {
 public:
  // Throws BadInput for another size.
  HiddenPixels(core::ImageView confidence, core::ImageView mask);

  std::size_t count() const { return places_.size(); }
  // Of the pixels inside the mask.
  double share() const { return subject_ == 0 ? 0 : double(count()) / double(subject_); }

  // `picture` is the one that hides them. What `other` hides itself, or shows black where this is not, says nothing. Throws BadInput for another
  // size, or a weight that is not positive.
  void add(core::ImageView picture, core::ImageView confidence, core::ImageView other, core::ImageView other_confidence,
           core::ImageView mask, double weight);

  // Sets them to what was predicted, and those that no picture showed to 0, which are set to 0 in `seen` (one channel) too.
  void fill(core::Image& picture, core::Image& seen) const;

 private:
  core::ImageSize size_;
  std::size_t subject_ = 0;
  std::vector<std::uint32_t> places_;  // y * width + x
  std::vector<double> sums_, weights_;
};

}  // namespace lightstage::align
