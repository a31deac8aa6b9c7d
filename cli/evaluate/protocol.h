// What every way of judging methods has in common.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cli/jobs/method_options.h"
#include "model/evaluation.h"

namespace lightstage::cli {

// Queries on one scan, with the truth for each.
struct Protocol {
  std::string name;                // as in JSON: "held-out"
  std::vector<std::string> notes;  // what a reader must know to judge the numbers
  // Scores of methods, in their order.
  std::function<std::vector<model::MethodScore>(std::span<const MethodChoice>)> evaluate;
  // Of the image whose ImageScore::index this is: the light asked for, its linear picture, and the scan that a method may know.
  std::function<core::Direction(std::size_t index)> query;
  std::function<core::Image(std::size_t index)> truth;
  std::function<core::OlatScan(std::size_t index)> known;
  bool one_scan = false;  // known() is the same for every image
};

// Every `every`-th light is left out in turn.
Protocol held_out(const core::OlatScan& scan, int every, const model::EvaluationOptions& options);

// Directions where no light stands, with their true pictures.
Protocol off_grid(const core::OlatScan& scan, std::vector<core::Direction> directions,
                  std::shared_ptr<const std::vector<core::Image>> truth, const model::EvaluationOptions& options);

// The functions by which model/evaluation.h makes the methods; `choices` must outlive them.
std::vector<model::InterpolatorFactory> factories(std::span<const MethodChoice> choices);

}  // namespace lightstage::cli
