#include "model/training.h"

#include <torch/torch.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>

#include "core/error.h"
#include "core/file.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/text.h"
#include "core/version.h"
#include "model/net/checkpoint_metadata.h"
#include "model/net/network.h"
#include "model/net/network_file.h"
#include "model/net/pixels.h"
#include "model/net/training_data.h"
#include "model/net/training_state.h"

namespace lightstage::model {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using torch::Tensor;

constexpr double kSquaredWeight = 4;
constexpr double kLargestGradient = 1;
constexpr int kWarmUpSteps = 20;
// Queries in training stand a whole light spacing away from their neighbours, and ask for flatter weights than users' queries do, which
// stand between lights: s follows the training slowly.
constexpr double kSharpnessRate = 0.1;

void check(const TrainOptions& options) {
  const auto require = [](bool holds, const std::string& problem) {
    if (!holds) throw core::UsageError("training: " + problem);
  };
  require(options.minutes || options.steps, "give the minutes or the steps that it may take");
  require(!options.minutes || (std::isfinite(*options.minutes) && *options.minutes > 0),
          "minutes must be a number > 0");
  require(!options.steps || *options.steps > 0, "steps must be > 0");
  require(options.crop > 0, "the crop must be > 0 pixels");
  require(options.candidates >= options.config.neighbours,
          "candidates must be at least the network's " + std::to_string(options.config.neighbours) + " neighbours");
  require(std::isfinite(options.learning_rate) && options.learning_rate > 0, "the learning rate must be a number > 0");
  require(options.validate_every > 0, "the steps between validations must be > 0");
}

// What must be equal for a run to be resumed.
Json settings(const Json& data, const TrainOptions& options) {
  return {{"data", data},
          {"config", Json::parse(config_to_json(options.config))},
          {"seed", options.seed},
          {"crop", options.crop},
          {"candidates", options.candidates},
          {"learning_rate", options.learning_rate},
          {"validate_every", options.validate_every},
          {"held_out_every", options.held_out_every},
          {"start_from", options.start_from ? options.start_from->filename().string() : ""}};
}

Json description(std::span<const core::OlatScan> scans) {
  Json names = Json::array();
  for (const core::OlatScan& scan : scans) {
    names.push_back({{"name", scan.name()},
                     {"lights", scan.light_count()},
                     {"height", scan.image_size().height},
                     {"width", scan.image_size().width}});
  }
  return names;
}

struct Errors {
  Tensor absolute, squared;  // means over the masked values
};

Errors errors(const Tensor& picture, const Example& example) {
  const Tensor difference = (picture - example.truth) * example.mask;
  const Tensor count = 3 * example.mask.sum();
  return {difference.abs().sum() / count, difference.square().sum() / count};
}

Tensor predict(const Network& network, const Example& example) {
  std::vector<std::size_t> all(example.lights.size());
  std::iota(all.begin(), all.end(), std::size_t(0));
  return network.predict(example.images, example.guide,
                         network.active_set(example.query, example.lights, all, example.spacing));
}

std::unique_ptr<Network> first_network(const TrainOptions& options) {
  if (!options.start_from) return make_network(options.config, options.seed);
  std::unique_ptr<Network> network = load_network(*options.start_from);
  if (!(network->config() == options.config)) {
    throw core::UsageError(options.start_from->string() + ": is a network of another configuration");
  }
  return network;
}

class Run {
 public:
  // `make_data` is given the size that windows must be multiples of.
  Run(const TrainOptions& options, const fs::path& out, const Json& data_description,
      const std::function<std::unique_ptr<TrainingData>(int multiple)>& make_data)
      : options_(options),
        out_(out),
        settings_(settings(data_description, options)),
        network_(first_network(options)),
        optimiser_(parameter_groups(*network_), torch::optim::AdamOptions(options.learning_rate).eps(1e-7)),
        data_(make_data(network_->size_multiple())) {}

  TrainReport train();

 private:
  static std::vector<torch::optim::OptimizerParamGroup> parameter_groups(const Network& network);

  void start();
  // False when the loss or a gradient was not finite; the weights are then as before.
  bool step();
  double validation(const std::function<torch::Tensor(const Example&)>& picture) const;
  double validation() const;
  void validate();
  void write_csv() const;
  double elapsed() const {
    return seconds_before_ + std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  }
  // Share of the budget that is used up.
  double fraction() const;
  void save();
  std::string provenance() const;
  void show(core::Progress& progress, std::size_t& shown, std::size_t total) const;

  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  const TrainOptions& options_;
  fs::path out_;
  Json settings_;
  std::unique_ptr<Network> network_;
  torch::optim::Adam optimiser_;
  std::unique_ptr<TrainingData> data_;
  TrainingState state_;
  double seconds_before_ = 0;  // of the runs that this one resumes
  double last_loss_ = 0;
};

std::vector<torch::optim::OptimizerParamGroup> Run::parameter_groups(const Network& network) {
  std::vector<Tensor> sharpness, others;
  for (const auto& [name, parameter] : network.parameters()) {
    (name == "log_sharpness" ? sharpness : others).push_back(parameter);
  }
  return {torch::optim::OptimizerParamGroup(others), torch::optim::OptimizerParamGroup(sharpness)};
}

void Run::start() {
  if (options_.resume) {
    state_ = load_state(state_path(*options_.resume), settings_.dump(), *network_, optimiser_);
    seconds_before_ = state_.seconds;
    if (*options_.resume != out_) {
      core::write_file_atomically(out_,
                                  core::read_text_file(*options_.resume, std::numeric_limits<std::size_t>::max()));
    }
    return;
  }
  state_.guide_validation = validation([](const Example& example) { return example.guide; });
  state_.best_validation = validation();
  save_network(out_, *network_, provenance());
  save();
}

double Run::fraction() const {
  double used = 0;
  if (options_.minutes) used = elapsed() / (60 * *options_.minutes);
  if (options_.steps) used = std::max(used, double(state_.step) / double(*options_.steps));
  return used;
}

bool Run::step() {
  const double warm_up = std::min(1.0, double(state_.step + 1) / kWarmUpSteps);
  const double decay = 0.01 + 0.99 * 0.5 * (1 + std::cos(std::numbers::pi * std::min(1.0, fraction())));
  auto& groups = optimiser_.param_groups();
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const double rate = options_.learning_rate * warm_up * decay * (i == 1 ? kSharpnessRate : 1);
    static_cast<torch::optim::AdamOptions&>(groups[i].options()).lr(rate);
  }

  const Example example = data_->training_draw(state_.step);
  const Errors error = errors(predict(*network_, example), example);
  const bool blend = network_->config().architecture == Architecture::kBlend;
  const Tensor loss = blend ? error.absolute + kSquaredWeight * error.squared : error.absolute;
  optimiser_.zero_grad();
  loss.backward();
  std::vector<Tensor> parameters;
  for (const auto& entry : network_->parameters()) parameters.push_back(entry.second);
  const double gradient = torch::nn::utils::clip_grad_norm_(parameters, kLargestGradient);
  if (!std::isfinite(loss.item<double>()) || !std::isfinite(gradient)) return false;
  optimiser_.step();

  ++state_.step;
  last_loss_ = error.absolute.item<double>();
  state_.loss_sum += last_loss_;
  ++state_.loss_count;
  return true;
}

double Run::validation(const std::function<Tensor(const Example&)>& picture) const {
  const torch::NoGradGuard no_gradients;
  double sum = 0;
  for (int i = 0; i < data_->validation_count(); ++i) {
    const Example example = data_->validation_draw(i);
    sum += errors(picture(example), example).absolute.item<double>();
  }
  return sum / data_->validation_count();
}

double Run::validation() const {
  return validation([&](const Example& example) { return predict(*network_, example); });
}

void Run::validate() {
  LossPoint point;
  point.step = state_.step;
  point.train = state_.loss_sum / double(std::max<std::int64_t>(state_.loss_count, 1));
  point.validation = validation();
  point.seconds = elapsed();
  state_.curve.push_back(point);
  state_.loss_sum = 0;
  state_.loss_count = 0;
  if (point.validation < state_.best_validation) {
    state_.best_validation = point.validation;
    save_network(out_, *network_, provenance());
  }
  save();
}

void Run::save() {
  state_.seconds = elapsed();
  save_state(state_path(out_), state_, settings_.dump(), *network_, optimiser_);
  write_csv();
}

void Run::write_csv() const {
  std::string text = "step,seconds,train_l1,validation_l1\n0,0,," + core::number_text(state_.guide_validation) + "\n";
  for (const LossPoint& p : state_.curve) {
    text += std::to_string(p.step) + "," + core::number_text(p.seconds, 6) + "," + core::number_text(p.train) + "," +
            core::number_text(p.validation) + "\n";
  }
  fs::path path = out_;
  path += ".csv";
  core::write_file_atomically(path, text);
}

std::string Run::provenance() const {
  Json json = settings_;
  json["program"] = core::kVersion;
  json["steps"] = state_.step;
  json["validation_l1"] = state_.best_validation;
  json["rbf_validation_l1"] = state_.guide_validation;
  return json.dump();
}

void Run::show(core::Progress& progress, std::size_t& shown, std::size_t total) const {
  const auto now = static_cast<std::size_t>(std::min(1.0, fraction()) * double(total));
  if (now > shown) progress.advance(now - shown);
  shown = std::max(shown, now);
  progress.set_status("step " + std::to_string(state_.step) + ", loss " + core::number_text(last_loss_, 3) +
                      ", validation " + core::number_text(state_.best_validation, 4) + " (rbf " +
                      core::number_text(state_.guide_validation, 4) + ")");
}

TrainReport Run::train() {
  start();
  TrainReport report;
  {
    // In seconds or steps, whichever bounds the run.
    const double total = options_.minutes ? 60 * *options_.minutes : double(*options_.steps);
    core::Progress progress("training", static_cast<std::size_t>(std::ceil(total)));
    std::size_t shown = 0;
    while (state_.step == 0 || fraction() < 1) {  // a slow start must not leave an untrained model
      if (core::interrupt_requested()) {
        save();
        core::note("training stops at step " + std::to_string(state_.step) + "; resume it from " + out_.string());
        core::throw_if_interrupted();
      }
      if (!step()) {
        report.stopped_by_nan = true;
        break;
      }
      if (state_.step % options_.validate_every == 0) validate();
      show(progress, shown, static_cast<std::size_t>(std::ceil(total)));
    }
  }
  if (report.stopped_by_nan) {
    core::warn("training: the loss is not finite after step " + std::to_string(state_.step) +
               "; the checkpoint is the best one before it. Train again with a lower learning rate");
  } else if (state_.loss_count > 0) {
    validate();
  }
  report.steps = state_.step;
  report.seconds = elapsed();
  for (const auto& entry : network_->parameters()) report.parameters += std::size_t(entry.second.numel());
  report.curve = state_.curve;
  report.best_validation = state_.best_validation;
  report.guide_validation = state_.guide_validation;
  return report;
}

}  // namespace

TrainReport train(std::span<const core::OlatScan> scans, const TrainOptions& options, const fs::path& out) {
  check(options);
  if (scans.empty()) throw core::UsageError("training: there is no scan to train on");
  const core::InterruptGuard guard;
  prepare_torch();
  return Run(options, out, description(scans), [&](int multiple) { return captured_data(scans, options, multiple); })
      .train();
}

TrainReport train(const SimulatedViews& views, const TrainOptions& options, const fs::path& out) {
  check(options);
  const core::InterruptGuard guard;
  prepare_torch();
  return Run(options, out, Json::parse(views.description),
             [&](int multiple) { return simulated_data(views, options, multiple); })
      .train();
}

}  // namespace lightstage::model
