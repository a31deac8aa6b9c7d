// Dense optical flow between pictures taken under the same light.
#pragma once

#include <array>
#include <string_view>
#include <utility>

#include "core/image.h"

namespace lightstage::align {

// A flow field has two channels (dx, dy) in pixels: what is at p in the reference picture is at p + flow(p) in the other one.
using FlowField = core::Image;

// Which algorithm, from the fastest to the slowest (docs/alignment.md has time and error of each).
enum class FlowPreset {
  kDisUltrafast,  // dense inverse search (Kroeger et al. 2016) at a quarter of the size
  kDisFast,       // the same with a variational refinement of 8-bit pictures
  kDisMedium,     // at half the size
  kFine,          // at full size, then refined on pictures that are not rounded to 8 bits (Brox et al. 2004)
  kFarneback,     // polynomial expansion (Farneback 2003)
  kTvl1,          // total variation and L1 (Zach et al. 2007)
  kDeepFlow,      // DeepFlow without its matches (Weinzaepfel et al. 2013): a pyramid of variational refinements
};
inline constexpr std::array<std::pair<std::string_view, FlowPreset>, 7> kFlowPresets{
    {{"dis-ultrafast", FlowPreset::kDisUltrafast},
     {"dis-fast", FlowPreset::kDisFast},
     {"dis-medium", FlowPreset::kDisMedium},
     {"fine", FlowPreset::kFine},
     {"farneback", FlowPreset::kFarneback},
     {"tvl1", FlowPreset::kTvl1},
     {"deepflow", FlowPreset::kDeepFlow}}};
std::string_view name_of(FlowPreset preset);

// Flow of display-encoded luminance, so that dark parts count. Pictures of equal size, 1 or 3 channels, linear, taken at one exposure
// (both are scaled by the reference's 99th percentile and clipped there, so that highlights, which do not move with the surface, count
// little). `shrink` > 1: of pictures that are so many times smaller. Where there is no texture the flow is what its surroundings have;
// 0 between even pictures. The same on any number of threads. Throws BadInput when sizes differ or are below 16 * shrink pixels, for a
// shrink below 1, or for values that are not finite.
FlowField compute_flow(core::ImageView reference, core::ImageView other, FlowPreset preset = FlowPreset::kFine,
                       int shrink = 1);

// How far flow there and back can be believed, one channel in [0, 1]: 1 - e^2 / t^2, where e is how far from where it started a pixel
// comes back and t^2 = 0.01 (|there|^2 + |back|^2) + 0.5 (Sundaram et al. 2010, eq. 5, call it occluded from there on: 0). 0 too where the
// pixel leaves the picture. `backward` is the flow from the other picture to the reference. Throws BadInput when sizes differ.
core::Image flow_confidence(const FlowField& forward, const FlowField& backward);

// The picture as it would look in the reference's pose: out(p) = picture(p + flow(p)), bicubic. Pixels are squares about their centres:
// those whose source lies outside [-0.5, size - 0.5] are 0. A value may leave the range of the samples it is made of by a tenth of the
// range's end, no more, so that dark pixels beside highlights stay non-negative. No flow is no change, bit for bit.
// Throws BadInput when the flow is of another size, or for values that are not finite.
core::Image warp(core::ImageView picture, const FlowField& flow);

// Sets to 0 what warp() leaves 0 because its source lies outside the picture. `confidence` has one channel. Throws BadInput for another size.
void clear_outside(core::Image& confidence, const FlowField& flow);

}  // namespace lightstage::align
