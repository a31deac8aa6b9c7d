// Which lights `xu` looks at, and how training comes to choose them (Xu et al. 2018, "Deep image-based relighting from optimal sparse
// samples").
//
// As published the sampling network is a matrix with a row for each picture that the relighting network is given and a column for each light of
// one fixed stage. Here a column stands for a direction, so that a choice made on one stage holds for another: on a stage it means the captured
// light nearest to that direction, however far that is where the stage has a hole.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/direction.h"

namespace lightstage::model {

// The directions that columns stand for: core::geodesic_directions(162), about 16 degrees apart.
const std::vector<core::Direction>& sampling_candidates();

// By candidate: the nearest of these lights, of which there is at least one.
std::vector<std::size_t> nearest_to_candidates(std::span<const core::Direction> lights);

// One candidate a row of `logits` [rows, candidates], all different: the largest logit of all is a row's choice, then the largest among the rows and
// columns that are left, and so on. Ties go to the lower index. Throws std::logic_error for more rows than candidates.
std::vector<std::size_t> chosen_candidates(std::span<const float> logits, std::size_t rows);

// By chosen candidate, in this order: the nearest light that is not taken yet. All different where there are that many lights; of fewer, lights are
// taken again once all are.
std::vector<std::size_t> lights_for(std::span<const std::size_t> candidates, std::span<const core::Direction> lights);

// The factor of the logits in the softmax after this share of the training budget: it grows until a row has one light only. By the same factor
// in equal times, so that lights are mixed for about half of the time, however many steps there are.
// Nothing in the rest of the run, in which the chosen lights stand firm.
std::optional<double> selection_sharpness(double fraction);

// How far that rest has come: 0 before it, 1 at its end.
double after_selection(double fraction);

// While lights are chosen, pictures are averaged down to 1 / 2^kSelectionLevel of their size: all lights of a stage are looked at.
inline constexpr int kSelectionLevel = 2;

}  // namespace lightstage::model
