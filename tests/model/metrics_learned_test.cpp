// A measure that the user brings as a TorchScript file.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <torch/script.h>
#pragma pop_macro("CHECK")

#include <fstream>

#include "core/error.h"
#include "model/learned_metric.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Image;

std::filesystem::path module_file(const test::TemporaryFolder& folder, const std::string& name,
                                  const std::string& body) {
  torch::jit::Module module("Metric");
  module.define("def forward(self, a, b):\n  " + body + "\n");
  const std::filesystem::path file = folder / (name + ".pt");
  module.save(file.string());
  return file;
}

// What construction and a call on two pictures say when they fail.
std::string failure(const std::filesystem::path& file) {
  try {
    model::LearnedMetric metric(file);
    metric(Image(3, 4, 3), Image(3, 4, 3), {});
  } catch (const core::BadInput& error) {
    return error.what();
  }
  return {};
}

}  // namespace

TEST_CASE("a TorchScript metric is given both pictures as NCHW, black outside the mask, under its file's name") {
  const test::TemporaryFolder folder;
  Image a(2, 3, 3), b(2, 3, 3), mask(2, 3, 1);
  a(1, 2, 0) = 0.5f;
  a(0, 1, 2) = 0.25f;
  b(0, 0, 1) = 1;
  const model::LearnedMetric sum(module_file(folder, "sum-v1", "return (a - b).sum()"));
  CHECK(sum.name() == "sum-v1");
  CHECK(sum(a, b, {}) == Approx(-0.25));
  mask(0, 1) = mask(1, 2) = 1;
  CHECK(sum(a, b, mask) == Approx(0.75));
  // Channel 2 at row 0, column 1, and the shape.
  CHECK(model::LearnedMetric(module_file(folder, "one", "return a[0, 2, 0, 1] + 100 * a.size(3)"))(a, b, {}) ==
        Approx(300.25));
  // Grey pictures are given in three channels; a number for a tensor will do.
  Image grey(2, 2, 1);
  grey(0, 0) = 1;
  CHECK(sum(grey, Image(2, 2, 1), {}) == Approx(3));
  CHECK(model::LearnedMetric(module_file(folder, "number", "return 1.5"))(a, b, {}) == 1.5);
}

TEST_CASE("a learned metric that cannot be used is refused in one line that names its file") {
  const test::TemporaryFolder folder;
  const auto check = [&](const std::filesystem::path& file, const std::string& said) {
    const std::string message = failure(file);
    CAPTURE(message);
    CHECK(message.find(file.filename().string()) != std::string::npos);
    CHECK(message.find(said) != std::string::npos);
    CHECK(message.find('\n') == std::string::npos);
  };
  check(folder / "absent.pt", "no such file");
  std::ofstream(folder / "text.pt") << "no module";
  check(folder / "text.pt", "is not a TorchScript module");
  std::filesystem::create_directory(folder / "folder.pt");
  check(folder / "folder.pt", "no such file");
  check(module_file(folder, "picture", "return a - b"), "must return one number, not 36");
  check(module_file(folder, "text_answer", "return 'good'"), "must return one number, not a str");
  check(module_file(folder, "nan", "return (a - b).sum() / 0"), "returned a number that is not finite");
  check(module_file(folder, "shape", "return (a[:, :, 1:] - b).sum()"), "4x3");
  model::LearnedMetric metric(module_file(folder, "good", "return (a - b).sum()"));
  CHECK_THROWS_AS(metric(Image(3, 4, 3), Image(4, 3, 3), {}), core::BadInput);
  CHECK_THROWS_AS(metric(Image(3, 4, 3), Image(3, 4, 3), Image(3, 4, 1)), core::BadInput);
}

}  // namespace lightstage
