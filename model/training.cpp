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

#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/text.h"
#include "core/version.h"
#include "model/net/adam.h"
#include "model/net/light_selection.h"
#include "model/net/loss_curve.h"
#include "model/net/network.h"
#include "model/net/network_file.h"
#include "model/net/pixels.h"
#include "model/net/progressive.h"
#include "model/net/training_data.h"
#include "model/net/training_loss.h"
#include "model/net/training_settings.h"
#include "model/net/training_state.h"

namespace lightstage::model {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using torch::Tensor;

constexpr double kLargestGradient = 1;
constexpr int kWarmUpSteps = 20;

fs::path with_ending(fs::path path, const char* ending) {
  path += ending;
  return path;
}

std::unique_ptr<Network> first_network(const TrainOptions& options) {
  if (!options.start_from) return make_network(options.config, options.seed);
  std::unique_ptr<Network> network = load_network(*options.start_from);
  if (!(network->config() == options.config)) {
    throw core::UsageError(options.start_from->string() + ": is a network of another configuration");
  }
  return network;
}

bool same_file(const fs::path& a, const fs::path& b) {
  std::error_code error;
  return fs::weakly_canonical(a, error) == fs::weakly_canonical(b, error);
}

// A run writes its first checkpoint before it has learned anything: over a finished model that would be the end of it.
void refuse_existing(const fs::path& out, const std::optional<fs::path>& resume) {
  if (out.filename().empty()) throw core::UsageError("training: '" + out.string() + "' names no file to write");
  if (resume && same_file(*resume, out)) return;
  for (const fs::path& file : {out, last_checkpoint_path(out)}) {
    std::error_code error;
    if (!fs::exists(file, error)) continue;
    throw core::UsageError("training: " + file.string() +
                           " exists and would be replaced; write to another file, or resume the run of " +
                           out.string());
  }
}

// The state beside a checkpoint that is to be resumed.
fs::path state_to_resume(const fs::path& checkpoint) {
  fs::path state = state_path(checkpoint);
  if (fs::exists(state)) return state;
  throw core::BadInput(checkpoint.string() + ": there is no " + state.filename().string() +
                       " beside it to resume from; a run is resumed from the file it was told to write, not from its "
                       "last.safetensors");
}

class Run {
 public:
  // `make_data` is given the size that windows must be multiples of.
  Run(const TrainOptions& options, const fs::path& out, const Json& data_description,
      const std::function<std::unique_ptr<TrainingData>(int multiple)>& make_data)
      : options_(options),
        out_(out),
        settings_(training_settings(data_description, options)),
        network_(first_network(options)),
        optimiser_(parameter_groups(*network_), torch::optim::AdamOptions(learning_rate(options)).eps(1e-7)),
        data_(make_data(network_->training_size_multiple())) {
    if (options.sharpness_rate == 0 && has_sharpness(options.config.architecture))
      network_->parameter("log_sharpness").set_requires_grad(false);
  }

  TrainReport train();

 private:
  static std::vector<torch::optim::OptimizerParamGroup> parameter_groups(const Network& network);

  void start();
  void set_learning_rates();
  // False when the loss or a gradient was not finite; the weights are then as before.
  bool step();
  double validation(const std::function<torch::Tensor(const Example&)>& picture) const;
  double validation() const;
  // Until the budget is used up, or for a reason that is then in the report.
  void take_steps(TrainReport& report);
  // False when the error was not finite; nothing has been written then.
  bool validate();
  bool out_of_patience() const;
  void write_curve() const;
  double elapsed() const {
    return seconds_before_ + std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  }
  // Share of the budget that is used up.
  double fraction() const;
  // Level of the pictures that are trained now; 0 when the network does not grow.
  double position() const;
  // A model that is trained on keeps its lights.
  bool selects() const { return options_.config.architecture == Architecture::kXu && !options_.start_from; }
  // How sharply xu chooses among lights now; nothing once they are chosen.
  std::optional<double> selection() const;
  Loss loss(const Example& example) const;
  void save();
  // The same when something was thrown, which matters more than a failure to save.
  void save_unfinished() noexcept;
  std::string provenance(double validation) const;
  void show(core::Progress& progress, std::size_t& shown, std::size_t total) const;

  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  const TrainOptions& options_;
  fs::path out_;
  Json settings_;
  std::unique_ptr<Network> network_;
  OnePassAdam optimiser_;
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
    state_ = load_state(state_to_resume(*options_.resume), settings_.dump(), *network_, optimiser_);
    seconds_before_ = state_.seconds;
    // The best weights so far, which may remain the best.
    if (!(load_network(*options_.resume)->config() == options_.config)) {
      throw core::BadInput(options_.resume->string() + ": is not the network of the run whose state stands beside it");
    }
    if (!same_file(*options_.resume, out_)) {
      core::write_file_atomically(out_,
                                  core::read_text_file(*options_.resume, std::numeric_limits<std::size_t>::max()));
    }
    return;
  }
  state_.guide_validation = validation([](const Example& example) { return example.guide; });
  state_.best_validation = state_.first_validation = validation();
  if (!std::isfinite(state_.first_validation)) {
    throw core::BadInput((options_.start_from ? options_.start_from->string() : "the untrained network") +
                         ": its pictures of what it is to be trained on are not finite");
  }
  save();  // first, so that a checkpoint always has its state beside it
  save_network(out_, *network_, provenance(state_.best_validation));
}

double Run::fraction() const {
  double used = 0;
  if (options_.minutes) used = elapsed() / (60 * *options_.minutes);
  if (options_.steps) used = std::max(used, double(state_.step) / double(*options_.steps));
  return used;
}

std::optional<double> Run::selection() const {
  return selects() ? selection_sharpness(fraction()) : std::nullopt;
}

double Run::position() const {
  if (selection()) return kSelectionLevel;
  return trains_progressively(options_) ? level_position(fraction(), int(options_.config.channels.size())) : 0;
}

void Run::set_learning_rates() {
  const double warm_up = std::min(1.0, double(state_.step + 1) / kWarmUpSteps);
  // A level that is trained in the last stage only must not find a rate that has decayed before.
  const double decaying = trains_progressively(options_) ? last_stage(position())
                          : selects()                    ? after_selection(fraction())
                                                         : std::min(1.0, fraction());
  const double decay = 0.01 + 0.99 * 0.5 * (1 + std::cos(std::numbers::pi * decaying));
  auto& groups = optimiser_.param_groups();
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const double rate = learning_rate(options_) * warm_up * decay * (i == 1 ? options_.sharpness_rate : 1);
    static_cast<torch::optim::AdamOptions&>(groups[i].options()).lr(rate);
  }
}

Loss Run::loss(const Example& example) const {
  if (trains_progressively(options_)) return progressive_loss(*network_, example, position());
  if (const auto sharpness = selection()) return selection_loss(*network_, example, *sharpness);
  return training_loss(*network_, example);
}

bool Run::step() {
  set_learning_rates();
  const Example example = data_->training_draw(state_.step);
  const Loss loss = this->loss(example);
  std::vector<Tensor> parameters;
  for (const auto& entry : network_->parameters()) {
    parameters.push_back(entry.second);
    // Undefined and not 0, so that Adam leaves levels that are not active alone.
    parameters.back().mutable_grad().reset();
  }
  loss.value.backward();
  const double gradient = torch::nn::utils::clip_grad_norm_(parameters, kLargestGradient);
  if (!std::isfinite(loss.value.item<double>()) || !std::isfinite(gradient)) return false;
  optimiser_.step();

  ++state_.step;
  last_loss_ = loss.l1.item<double>();
  state_.loss_sum += last_loss_;
  ++state_.loss_count;
  return true;
}

double Run::validation(const std::function<Tensor(const Example&)>& picture) const {
  const torch::NoGradGuard no_gradients;
  double sum = 0;
  for (int i = 0; i < data_->validation_count(); ++i) {
    const Example example = data_->validation_draw(i);
    sum += masked_l1(picture(example), example).item<double>();
  }
  return sum / data_->validation_count();
}

double Run::validation() const {
  return validation([&](const Example& example) { return predict(*network_, example); });
}

bool Run::validate() {
  LossPoint point;
  point.step = state_.step;
  point.train = state_.loss_sum / double(std::max<std::int64_t>(state_.loss_count, 1));
  point.validation = validation();
  if (!std::isfinite(point.validation)) return false;
  point.seconds = elapsed();
  point.level = position();
  if (point.validation < state_.best_validation) {
    save_network(out_, *network_, provenance(point.validation));
    state_.best_validation = point.validation;
  }
  state_.curve.push_back(point);
  state_.loss_sum = 0;
  state_.loss_count = 0;
  save();
  return true;
}

void Run::save() {
  state_.seconds = elapsed();
  save_state(state_path(out_), state_, settings_.dump(), *network_, optimiser_);
  const double last = state_.curve.empty() ? state_.best_validation : state_.curve.back().validation;
  save_network(last_checkpoint_path(out_), *network_, provenance(last));
  write_curve();
}

void Run::save_unfinished() noexcept {
  try {
    save();
    core::note("training stops at step " + std::to_string(state_.step) + "; resume it from " + out_.string());
  } catch (const std::exception& error) {
    core::warn("training stops at step " + std::to_string(state_.step) + ", which was not saved: " + error.what());
  }
}

bool Run::out_of_patience() const {
  if (options_.early_stop == 0) return false;
  double best = std::numeric_limits<double>::infinity();
  int without_improvement = 0;
  for (const LossPoint& point : state_.curve) {
    if (point.level >= 1) continue;
    without_improvement = point.validation < best ? 0 : without_improvement + 1;
    best = std::min(best, point.validation);
  }
  return without_improvement >= options_.early_stop;
}

void Run::write_curve() const {
  core::write_file_atomically(with_ending(out_, ".csv"), loss_curve_csv(state_.curve, state_.first_validation));
  core::write_image(with_ending(out_, ".png"),
                    draw_loss_curve(state_.curve, state_.first_validation, state_.guide_validation),
                    {.pixel_type = core::PixelType::kUint8, .encoding = core::Encoding::kLinear});
}

std::string Run::provenance(double validation) const {
  Json json = settings_;
  json["program"] = core::kVersion;
  json["steps"] = state_.step;
  json["validation_l1"] = validation;
  json["rbf_validation_l1"] = state_.guide_validation;
  return json.dump();
}

void Run::show(core::Progress& progress, std::size_t& shown, std::size_t total) const {
  const auto now = static_cast<std::size_t>(std::min(1.0, fraction()) * double(total));
  if (now > shown) progress.advance(now - shown);
  shown = std::max(shown, now);
  const std::string level =
      trains_progressively(options_) || selection() ? ", level " + core::number_text(position(), 2) : "";
  progress.set_status("step " + std::to_string(state_.step) + level + ", loss " + core::number_text(last_loss_, 3) +
                      ", validation " + core::number_text(state_.best_validation, 4) + " (rbf " +
                      core::number_text(state_.guide_validation, 4) + ")");
}

void Run::take_steps(TrainReport& report) {
  // In seconds or steps, whichever bounds the run.
  const auto total =
      static_cast<std::size_t>(std::ceil(options_.minutes ? 60 * *options_.minutes : double(*options_.steps)));
  core::Progress progress("training", total);
  std::size_t shown = 0;
  while (state_.step == 0 || fraction() < 1) {  // a slow start must not leave an untrained model
    core::throw_if_interrupted();
    if (!step()) {
      report.stopped_by_nan = true;
      return;
    }
    if (state_.step % options_.validate_every == 0) {
      report.stopped_by_nan = !validate();
      report.stopped_early = out_of_patience();
      if (report.stopped_by_nan || report.stopped_early) return;
    }
    show(progress, shown, total);
  }
  if (state_.loss_count > 0) report.stopped_by_nan = !validate();
}

TrainReport Run::train() {
  start();
  TrainReport report;
  try {
    take_steps(report);
  } catch (...) {
    // Ctrl-C, a picture that cannot be read, memory or disk used up: all of that before a step changes anything.
    save_unfinished();
    throw;
  }
  if (report.stopped_by_nan) {
    core::warn("training: the loss is not finite after step " + std::to_string(state_.step) +
               "; the checkpoint is the best one before it. Train again with a lower learning rate");
  }
  if (report.stopped_early) {
    core::note("training stops early at step " + std::to_string(state_.step) + ": " +
               std::to_string(options_.early_stop) + " validations without a new best one");
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
  refuse_existing(out, options.resume);
  if (scans.empty()) throw core::UsageError("training: there is no scan to train on");
  const core::InterruptGuard guard;
  prepare_torch();
  return Run(options, out, description(scans), [&](int multiple) { return captured_data(scans, options, multiple); })
      .train();
}

fs::path last_checkpoint_path(const fs::path& out) {
  constexpr const char* kExtension = ".safetensors";
  fs::path path = out.extension() == kExtension ? fs::path(out).replace_extension() : out;
  return with_ending(std::move(path), ".last.safetensors");
}

TrainReport train(const SimulatedViews& views, const TrainOptions& given, const fs::path& out) {
  TrainOptions options = given;
  options.active_set = ActiveSetChoice::kNaive;  // for the record
  check(options);
  refuse_existing(out, options.resume);
  const core::InterruptGuard guard;
  prepare_torch();
  return Run(options, out, Json::parse(views.description),
             [&](int multiple) { return simulated_data(views, options, multiple); })
      .train();
}

}  // namespace lightstage::model
