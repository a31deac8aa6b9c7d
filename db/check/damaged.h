// Pictures that are damaged or mislabelled, found by what their neighbours predict.
#pragma once

#include <span>
#include <vector>

#include "core/direction.h"
#include "core/image.h"

namespace lightstage::db {

// What the search looks at, per picture (see thumbnail.h). All of one size each, linear light divided by the
// lights' gains.
struct DamageFeatures {
  core::Image shape;   // thumbnail, kDamageSide
  core::Image detail;  // row_detail, kDetailSide
};

enum class DamageKind {
  kBlack,  // (nearly) no light in it
  kWhole,  // too bright, too dark, or of another light
  kRows,   // torn: rows do not go with the rows beside them
};

struct Damage {
  std::size_t index = 0;
  DamageKind kind = DamageKind::kWhole;
  // How many times farther from its neighbours' prediction than they are from one another; of a black one its brightness as a share of
  // what the set's pictures mostly have.
  double ratio = 0;
};

// Pictures with (nearly) no light in them: those whose bright parts (95th percentile) have less than a twentieth of what the set's brighter
// pictures have there, when their light stands before the subject, where it cannot but light it; of lights behind, those with less than a
// fiftieth of the brightest picture around. Half a set may be black and be found. `shapes` as in DamageFeatures; the mask has their size, or
// is empty. On the real sets the darkest sound picture has 0.22 of the brightness in front, 0.046 behind. Empty for fewer than 3 pictures.
std::vector<Damage> find_black(std::span<const core::Direction> directions, std::span<const core::Image> shapes,
                               const core::Image& mask);

// Each picture is predicted from the 6 around it (inverse-angle weights, display-encoded). The error of that
// over the neighbours' own spread does not depend on how far apart lights are or how fast shading changes
// there. A picture is damaged when this ratio is both above 2.5 and more than 5 robust standard deviations
// (median and MAD of the logarithms) above the set's. They are taken out one at a time, worst first, so that
// a damaged picture does not accuse or excuse its neighbours. Empty for fewer than 16 pictures, or such small ones that their thumbnail has less
// than 64 pixels. The mask (empty, or like `shape` and `detail` in size) weighs pixels. On the real sets: sound
// pictures stay below 2.1, torn ones begin at 3.2.
std::vector<Damage> find_damaged(std::span<const core::Direction> directions, std::span<const DamageFeatures> features,
                                 const DamageFeatures& mask);

}  // namespace lightstage::db
