#include "model/learned_metric.h"

#include <torch/script.h>

#include <cmath>

#include "core/error.h"
#include "model/judging/comparison.h"

namespace lightstage::model {

namespace {

using torch::Tensor;

Tensor masked_tensor(const Comparison& pair, core::ImageView picture) {
  constexpr int kChannels = 3;
  const core::Image rgb = core::to_rgb(picture);
  Tensor result = torch::zeros({1, kChannels, picture.height(), picture.width()});
  auto values = result.accessor<float, 4>();
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x)
      for (int c = 0; c < kChannels; ++c)
        if (pair.inside(y, x)) values[0][c][y][x] = rgb(y, x, c);
  return result;
}

// torch's messages have many lines, of which the last says what went wrong in the module.
std::string reason(const std::exception& error) {
  std::string text = error.what();
  while (!text.empty() && text.back() == '\n') text.pop_back();
  const std::size_t line = text.find_last_of('\n');
  return line == std::string::npos ? text : text.substr(line + 1);
}

}  // namespace

struct LearnedMetric::Module {
  mutable torch::jit::Module script;  // forward is not const, though it changes nothing
};

LearnedMetric::LearnedMetric(const std::filesystem::path& file) : file_(file), name_(file.stem().string()) {
  if (!std::filesystem::is_regular_file(file)) throw core::BadInput(file.string() + ": no such file");
  try {
    module_ = std::make_unique<Module>(Module{torch::jit::load(file.string())});
    module_->script.eval();
  } catch (const std::exception&) {
    throw core::BadInput(file.string() +
                         ": is not a TorchScript module; save one with torch.jit.script(...).save(FILE)");
  }
  if (!module_->script.find_method("forward"))
    throw core::BadInput(file.string() + ": the TorchScript module has no method forward");
}

LearnedMetric::~LearnedMetric() = default;
LearnedMetric::LearnedMetric(LearnedMetric&&) noexcept = default;

const std::string& LearnedMetric::name() const {
  return name_;
}

double LearnedMetric::operator()(core::ImageView a, core::ImageView b, core::ImageView mask) const {
  const Comparison pair(a, b, mask);
  const torch::NoGradGuard no_gradients;
  torch::IValue answer;
  try {
    answer = module_->script.forward({masked_tensor(pair, a), masked_tensor(pair, b)});
  } catch (const std::exception& error) {
    throw core::BadInput(file_.string() + ": failed on two pictures of " + std::to_string(a.width()) + "x" +
                         std::to_string(a.height()) + ": " + reason(error));
  }
  double value = NAN;
  if (answer.isDouble()) {
    value = answer.toDouble();
  } else if (answer.isTensor() && answer.toTensor().numel() == 1) {
    value = answer.toTensor().item<double>();
  } else {
    throw core::BadInput(file_.string() + ": must return one number, not " +
                         (answer.isTensor() ? std::to_string(answer.toTensor().numel()) + " of them"
                                            : "a " + answer.type()->repr_str()));
  }
  if (!std::isfinite(value)) throw core::BadInput(file_.string() + ": returned a number that is not finite");
  return value;
}

}  // namespace lightstage::model
