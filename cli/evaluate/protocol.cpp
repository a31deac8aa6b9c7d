#include "cli/evaluate/protocol.h"

#include <utility>

namespace lightstage::cli {

Protocol held_out(const core::OlatScan& scan, int every, const model::EvaluationOptions& options) {
  return {
      .name = "held-out",
      .notes = {"Queries are captured lights that were left out, a whole spacing from their neighbours; a user's stand "
                "about half of that from the nearest. Networks trained with --active-set naive, whose every query is "
                "such a light seen from its nearest neighbours, are favoured by this protocol."},
      .evaluate =
          [=](std::span<const MethodChoice> choices) {
            return model::evaluate_held_out(scan, factories(choices), every, options);
          },
      .query = [=](std::size_t index) { return scan.directions().at(index); },
      .truth = [=](std::size_t index) { return *scan.image(index); },
      .known = [=](std::size_t index) { return model::without_light(scan, index); }};
}

Protocol off_grid(const core::OlatScan& scan, std::vector<core::Direction> directions,
                  std::shared_ptr<const std::vector<core::Image>> truth, const model::EvaluationOptions& options) {
  return {.name = "off-grid",
          .notes = {"Queries are random directions where the stage has lights; the truth is the simulator's rendering "
                    "without noise."},
          .evaluate =
              [=](std::span<const MethodChoice> choices) {
                return model::evaluate_against_truth(
                    scan, factories(choices), directions, [&](std::size_t i) { return truth->at(i); }, options);
              },
          .query = [=](std::size_t index) { return directions.at(index); },
          .truth = [=](std::size_t index) { return truth->at(index); },
          .known = [=](std::size_t) { return scan; },
          .one_scan = true};
}

std::vector<model::InterpolatorFactory> factories(std::span<const MethodChoice> choices) {
  std::vector<model::InterpolatorFactory> made;
  for (const MethodChoice& choice : choices) {
    made.push_back([&choice](const core::OlatScan& scan) {
      return model::make_interpolator(choice.method, scan, choice.options);
    });
  }
  return made;
}

}  // namespace lightstage::cli
