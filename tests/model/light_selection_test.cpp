// Which lights `xu` looks at: directions that carry over from stage to stage, all different, and sharper and sharper in training.
#include <catch2/catch.hpp>
#include <set>
#include <stdexcept>

#include "core/sphere.h"
#include "model/net/light_selection.h"

namespace lightstage {
namespace {

using core::Direction;

std::size_t distinct(const std::vector<std::size_t>& indices) {
  return std::set<std::size_t>(indices.begin(), indices.end()).size();
}

}  // namespace

TEST_CASE("candidates cover the sphere evenly, and on a stage they mean the lights nearest to them") {
  const std::vector<Direction>& candidates = model::sampling_candidates();
  REQUIRE(candidates.size() == 162);
  CHECK(core::degrees_from_radians(core::median_spacing_radians(candidates)) == Approx(16).margin(2));
  const auto lights = core::random_directions(37, 5);
  const std::vector<std::size_t> nearest = model::nearest_to_candidates(lights);
  REQUIRE(nearest.size() == candidates.size());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    for (const Direction& light : lights) {
      CHECK(angle_radians(candidates[i], lights[nearest[i]]) <= angle_radians(candidates[i], light));
    }
  }
}

TEST_CASE("each row chooses its largest logit, and where two want the same, the one that wants it more gets it") {
  const std::size_t columns = model::sampling_candidates().size();
  std::vector<float> logits(3 * columns, 0);
  logits[0 * columns + 7] = 1;
  logits[0 * columns + 100] = 0.5;
  logits[1 * columns + 7] = 2;
  logits[2 * columns + 40] = 0.1f;
  CHECK(model::chosen_candidates(logits, 3) == std::vector<std::size_t>{100, 7, 40});
  // All equal: still all different.
  CHECK(distinct(model::chosen_candidates(std::vector<float>(64 * columns, 0), 64)) == 64);
  CHECK_THROWS_AS(model::chosen_candidates(logits, 2), std::logic_error);
}

TEST_CASE("a choice holds for stages whose lights stand elsewhere, and lights are all different as long as they last") {
  const std::vector<std::size_t> chosen{0, 30, 60, 90, 120, 150};
  const auto& candidates = model::sampling_candidates();
  CHECK(model::lights_for(chosen, candidates) == chosen);
  // Lights that are off by up to 3 degrees, in the opposite order.
  std::vector<Direction> moved;
  const auto shifts = core::random_directions(candidates.size(), 8);
  for (std::size_t i = candidates.size(); i-- > 0;) {
    moved.push_back(Direction::from_vector(candidates[i].vec() + 0.05 * shifts[i].vec()));
  }
  const std::vector<std::size_t> found = model::lights_for(chosen, moved);
  for (std::size_t i = 0; i < chosen.size(); ++i) CHECK(found[i] == candidates.size() - 1 - chosen[i]);

  for (const std::size_t lights : {6, 7, 20}) {
    const auto stage = core::random_directions(lights, lights);
    CHECK(distinct(model::lights_for(chosen, stage)) == chosen.size());
    CHECK(model::lights_for(chosen, stage).front() == core::nearest_indices(stage, candidates[0], 1).front());
  }
  for (const std::size_t lights : {1, 2, 3, 5}) {
    CHECK(distinct(model::lights_for(chosen, core::random_directions(lights, 3))) == lights);
  }
  CHECK(distinct(model::lights_for(chosen, std::vector<Direction>(8))) == chosen.size());  // all in one place
}

TEST_CASE("the choice grows sharper until it stands, and the rest of the budget is for the picture") {
  double last = 0;
  for (const double fraction : {0.0, 0.1, 0.2, 0.3, 0.333}) {
    REQUIRE(model::selection_sharpness(fraction));
    CHECK(*model::selection_sharpness(fraction) > last);
    CHECK(model::after_selection(fraction) == 0);
    last = *model::selection_sharpness(fraction);
  }
  CHECK_FALSE(model::selection_sharpness(1.0 / 3));
  CHECK_FALSE(model::selection_sharpness(1.7));
  CHECK(model::after_selection(2.0 / 3) == Approx(0.5));
  CHECK(model::after_selection(1) == 1);
  CHECK(model::after_selection(3) == 1);
}

}  // namespace lightstage
