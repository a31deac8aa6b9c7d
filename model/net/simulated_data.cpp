#include <algorithm>
#include <map>

#include "core/error.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/classical/radial_basis.h"
#include "model/net/draws.h"
#include "model/net/scan_tensors.h"
#include "model/net/training_data.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

// Making a view takes about as long as twenty steps; so many of them pass before the next one is made.
constexpr std::size_t kFirstViews = 4;
constexpr std::int64_t kStepsPerView = 25;
constexpr std::size_t kValidationViews = 4;
constexpr int kDrawsPerValidationView = 8;

class View {
 public:
  View(const TruthView& view, const NetworkConfig& config, int multiple)
      : queries_(view.queries),
        stage_(view.scan.directions()),
        spacing_(core::median_spacing_radians(view.scan.directions())),
        tensors_(view.scan, multiple) {
    const std::vector<core::Direction>& lights = view.scan.directions();
    const RadialBasisWeights interpolation(lights);
    Tensor weights = torch::empty({std::int64_t(queries_.size()), std::int64_t(lights.size())});
    for (std::size_t i = 0; i < queries_.size(); ++i) {
      const std::vector<double> row = interpolation(queries_[i]);
      std::transform(row.begin(), row.end(), weights.data_ptr<float>() + i * row.size(),
                     [](double w) { return float(w); });
      active_.push_back(core::nearest_indices(lights, queries_[i], std::size_t(config.neighbours)));
      std::vector<core::Direction> directions;
      for (const std::size_t light : active_.back()) directions.push_back(lights[light]);
      lights_.push_back(std::move(directions));
    }
    guides_ = weighted_pictures(weights, tensors_.displays());
    const double exposure = view.scan.exposure();
    truth_ = tensors_.stack(queries_.size(), [&](std::size_t i) { return to_display(view.truth[i], exposure); });
    if (config.architecture == Architecture::kMeka) gradients_ = gradient_pictures(view.scan, tensors_);
  }

  Example example(std::size_t query, std::uint64_t anchor, int crop) const {
    const Window window = tensors_.window_around(anchor, crop);
    Example example;
    example.query = queries_[query];
    example.lights = lights_[query];
    example.spacing = spacing_;
    example.images = pictures(tensors_.displays(), active_[query], window);
    example.guide = pictures(guides_, {query}, window);
    example.truth = pictures(truth_, {query}, window);
    example.mask = cut(tensors_.mask(), window).unsqueeze(0);
    example.stage = {stage_, [this, window](const std::vector<std::size_t>& lights) {
                       return pictures(tensors_.displays(), lights, window);
                     }};
    if (gradients_.defined()) example.gradients = pictures(gradients_, {0, 1}, window);
    return example;
  }

  std::size_t queries() const { return queries_.size(); }

 private:
  std::vector<core::Direction> queries_, stage_;
  double spacing_;
  ScanTensors tensors_;
  std::vector<std::vector<std::size_t>> active_;
  std::vector<std::vector<core::Direction>> lights_;
  Tensor guides_, truth_, gradients_;
};

core::Direction mirrored(const core::Direction& d) {
  return core::Direction::from_vector({-d.x(), d.y(), d.z()});
}

Tensor mirrored(const Tensor& pictures) {
  return pictures.flip(3).contiguous(at::MemoryFormat::ChannelsLast);
}

// The same subject seen in a mirror: left is right, of pictures and of lights.
Example mirrored(Example example) {
  for (Tensor* tensor : {&example.images, &example.guide, &example.truth, &example.mask}) *tensor = mirrored(*tensor);
  example.query = mirrored(example.query);
  for (core::Direction& light : example.lights) light = mirrored(light);
  for (core::Direction& light : example.stage.lights) light = mirrored(light);
  example.stage.pictures = [pictures = std::move(example.stage.pictures)](const std::vector<std::size_t>& lights) {
    return mirrored(pictures(lights));
  };
  if (example.gradients.defined()) {
    // What grows to the right, red, changes places with what grows to the left.
    const Tensor& seen = example.gradients;
    example.gradients = mirrored(torch::cat({seen.flip(0).narrow(1, 0, 1), seen.narrow(1, 1, 2)}, 1));
  }
  return example;
}

class SimulatedData : public TrainingData {
 public:
  SimulatedData(const SimulatedViews& views, const TrainOptions& options, int multiple)
      : source_(views),
        seed_(options.seed),
        config_(options.config),
        crop_(std::max(options.crop / multiple, 1) * multiple),
        multiple_(multiple) {
    if (views.count <= kValidationViews) {
      throw core::UsageError("training on simulated views needs more than " + std::to_string(kValidationViews) +
                             " of them");
    }
    core::Progress progress("simulating the views for validation", kValidationViews);
    for (std::size_t i = 0; i < kValidationViews; ++i) {
      view(i);
      progress.advance();
    }
  }

  Example training_draw(std::int64_t number) override {
    std::mt19937_64 random = draw_generator(seed_, Stream::kTraining, number);
    const std::size_t made =
        std::min(source_.count - kValidationViews, kFirstViews + std::size_t(number / kStepsPerView));
    const View& chosen = view(kValidationViews + random() % made);
    const std::size_t query = random() % chosen.queries();
    Example example = chosen.example(query, random(), crop_);
    return random() % 2 ? mirrored(std::move(example)) : example;
  }

  int validation_count() const override { return int(kValidationViews) * kDrawsPerValidationView; }

  Example validation_draw(int number) override {
    std::mt19937_64 random = draw_generator(seed_, Stream::kValidation, number);
    const View& chosen = view(std::size_t(number) % kValidationViews);
    return chosen.example(std::size_t(number) / kValidationViews % chosen.queries(), random(), crop_);
  }

 private:
  const View& view(std::size_t index) {
    const auto found = views_.find(index);
    if (found != views_.end()) return found->second;
    return views_.try_emplace(index, source_.make(index), config_, multiple_).first->second;
  }

  SimulatedViews source_;
  std::uint64_t seed_;
  NetworkConfig config_;
  int crop_, multiple_;
  std::map<std::size_t, View> views_;
};

}  // namespace

std::unique_ptr<TrainingData> simulated_data(const SimulatedViews& views, const TrainOptions& options, int multiple) {
  return std::make_unique<SimulatedData>(views, options, multiple);
}

}  // namespace lightstage::model
