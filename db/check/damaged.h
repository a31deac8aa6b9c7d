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

struct Damage {
  std::size_t index = 0;
  double error_ratio = 0;  // how many times farther from its neighbours' prediction than they are from one another
  bool in_detail = false;  // the rows are torn rather than the whole too bright, too dark or another
};

// Each picture is predicted from the 6 around it (inverse-angle weights, display-encoded). The error of that
// over the neighbours' own spread does not depend on how far apart lights are or how fast shading changes
// there. A picture is damaged when this ratio is both above 2.5 and more than 5 robust standard deviations
// (median and MAD of the logarithms) above the set's. They are taken out one at a time, worst first, so that
// a damaged picture does not accuse or excuse its neighbours. Empty for fewer than 16 pictures. The mask
// (empty, or like `shape` and `detail` in size) weighs pixels. On the real sets: sound pictures stay
// below 2.1, torn or nearly black ones begin at 3.2.
std::vector<Damage> find_damaged(std::span<const core::Direction> directions, std::span<const DamageFeatures> features,
                                 const DamageFeatures& mask);

}  // namespace lightstage::db
