// A measure of the user's own, through the program.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <torch/script.h>
#pragma pop_macro("CHECK")

#include "cli/darkroom.h"

using namespace lightstage;

TEST_CASE("a TorchScript metric is reported under its file's name beside the others") {
  const test::Darkroom darkroom;
  torch::jit::Module module("Metric");
  module.define("def forward(self, a, b):\n  return ((a - b) ** 2).mean()\n");
  module.save(darkroom / "squares.pt");
  const test::Outcome outcome = darkroom.run({"evaluate", "ball", "--held-out", "--every", "6", "--method",
                                              "rbf,nearest", "--metric-model", darkroom / "squares.pt", "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  for (const auto all = outcome.json()["methods"]; const auto& method : all) {
    // This scan's mask is everything, so that the mean of squares is that of rmse.
    CHECK(method["metric_model"]["squares"].get<double>() ==
          Approx(std::pow(method["rmse"].get<double>(), 2)).epsilon(1e-4));
  }
  const test::Outcome text = darkroom.run({"evaluate", "ball", "--held-out", "--every", "6", "--method", "rbf,nearest",
                                           "--metric-model", darkroom / "squares.pt", "--quiet"});
  CHECK(text.out.find(" squares ") != std::string::npos);
}
