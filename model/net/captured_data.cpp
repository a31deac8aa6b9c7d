#include <algorithm>

#include "core/display.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/classical/distinct_lights.h"
#include "model/classical/radial_basis.h"
#include "model/colour_gradients.h"
#include "model/net/draws.h"
#include "model/net/network.h"
#include "model/net/scan_tensors.h"
#include "model/net/training_data.h"
#include "model/net/training_settings.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr std::size_t kGuideLights =
    256;  // farther ones weigh next to nothing, and the system is cubic in their number
constexpr std::size_t kThinnedFrom = 128;
constexpr std::size_t kLightsPerHeldOut = 16;
constexpr int kValidationDraws = 24;

// `count` different ones of `all`, in the order in which they stand there.
std::vector<std::size_t> random_subset(const std::vector<std::size_t>& all, std::size_t count,
                                       std::mt19937_64& random) {
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < all.size() && chosen.size() < count; ++i) {
    // Knuth 1997, "The art of computer programming", volume 2, algorithm 3.4.2 S.
    if (random() % (all.size() - i) < count - chosen.size()) chosen.push_back(all[i]);
  }
  return chosen;
}

class CapturedScan {
 public:
  CapturedScan(const core::OlatScan& scan, const TrainOptions& options, int multiple);

  // Lights that serve as truth in training, and others that serve as truth in validation only: about one in sixteen.
  const std::vector<std::size_t>& training_lights() const { return training_lights_; }
  const std::vector<std::size_t>& validation_lights() const { return validation_lights_; }
  // The lights nearest to a light, at most m of them, nearest first: neither itself nor others in its place.
  const std::vector<std::size_t>& candidates(std::size_t light) const { return candidates_[light]; }

  Window window_around(std::uint64_t anchor, int size) const { return tensors_->window_around(anchor, size); }
  Example example(std::size_t light, const std::vector<std::size_t>& active, const Window& window) const;
  // The light between the `count` nearest of a stage thinned around it.
  Example thinned_example(std::size_t light, std::size_t count, std::mt19937_64& random, const Window& window) const;

 private:
  void choose_neighbours(int candidates);
  void interpolate_guides(core::Progress& progress);
  Tensor gradients_without(std::size_t light, const Tensor& picture, const Window& window) const;
  std::vector<std::size_t> thinned_lights(std::size_t light, std::size_t at_least, std::mt19937_64& random) const;

  std::vector<core::Direction> directions_;
  double spacing_;
  std::vector<std::size_t> training_lights_, validation_lights_;
  std::vector<std::vector<std::size_t>> apart_;  // by light: all lights in other places, nearest first
  std::vector<std::vector<std::size_t>> candidates_;
  std::unique_ptr<const ScanTensors> tensors_;
  Tensor guides_;  // [lights, 3, h, w]; not for thinned stages, which have their own
  Tensor gradients_;
  std::array<std::vector<core::Vec3>, 2> gradient_weights_;
};

CapturedScan::CapturedScan(const core::OlatScan& scan, const TrainOptions& options, int multiple)
    : directions_(scan.directions()), spacing_(core::median_spacing_radians(scan.directions())) {
  const std::size_t lights = directions_.size();
  const int neighbours = options.config.neighbours;
  if (lights < std::size_t(neighbours) + 1) {
    throw core::UsageError("scan '" + scan.name() + "' has " + std::to_string(lights) +
                           (lights == 1 ? " light" : " lights") + " to learn from; training with " +
                           std::to_string(neighbours) + " neighbours needs at least " + std::to_string(neighbours + 1));
  }
  choose_neighbours(options.candidates);
  if (std::any_of(candidates_.begin(), candidates_.end(), [](const auto& c) { return c.empty(); })) {
    throw core::UsageError("scan '" + scan.name() + "' has all its lights in one place; there is nothing to train on");
  }
  for (std::size_t light = 0; light < lights; ++light) {
    const bool held_out = light % kLightsPerHeldOut == std::min(kLightsPerHeldOut, lights) / 2;
    (held_out ? validation_lights_ : training_lights_).push_back(light);
  }
  const bool thinned = active_set_choice(options) == ActiveSetChoice::kThinned;
  core::Progress progress("preparing '" + scan.name() + "'", thinned ? lights : 2 * lights);
  tensors_ = std::make_unique<const ScanTensors>(scan, multiple, [&] { progress.advance(); });
  if (!thinned) interpolate_guides(progress);
  if (options.config.architecture == Architecture::kMeka) {
    gradients_ = gradient_pictures(scan, *tensors_);
    gradient_weights_ = colour_gradient_weights(directions_);
  }
}

void CapturedScan::choose_neighbours(int candidates) {
  for (const core::Direction& light : directions_) {
    std::vector<std::size_t> others = core::nearest_indices(directions_, light, directions_.size());
    std::erase_if(others, [&](std::size_t other) { return angle_radians(light, directions_[other]) < kSamePlace; });
    candidates_.emplace_back(others.begin(),
                             others.begin() + std::ptrdiff_t(std::min(others.size(), std::size_t(candidates))));
    apart_.push_back(std::move(others));
  }
}

void CapturedScan::interpolate_guides(core::Progress& progress) {
  const auto lights = std::int64_t(directions_.size());
  Tensor weights = torch::zeros({lights, lights});
  for (std::int64_t light = 0; light < lights; ++light) {
    core::throw_if_interrupted();
    std::vector<std::size_t> used = apart_[std::size_t(light)];
    used.resize(std::min(used.size(), kGuideLights));
    std::vector<core::Direction> directions;
    for (const std::size_t index : used) directions.push_back(directions_[index]);
    const std::vector<double> w = RadialBasisWeights(directions)(directions_[std::size_t(light)]);
    float* const row = weights.data_ptr<float>() + light * lights;
    for (std::size_t i = 0; i < used.size(); ++i) row[used[i]] = float(w[i]);
    progress.advance();
  }
  guides_ = weighted_pictures(weights, tensors_->displays());
}

Example CapturedScan::example(std::size_t light, const std::vector<std::size_t>& active, const Window& window) const {
  Example example;
  example.query = directions_[light];
  for (const std::size_t index : active) example.lights.push_back(directions_[index]);
  example.spacing = spacing_;
  example.images = pictures(tensors_->displays(), active, window);
  example.guide = pictures(guides_, {light}, window);
  example.truth = pictures(tensors_->displays(), {light}, window);
  example.mask = cut(tensors_->mask(), window).unsqueeze(0);
  for (const std::size_t other : apart_[light]) example.stage.lights.push_back(directions_[other]);
  example.stage.pictures = [this, light, window](const std::vector<std::size_t>& others) {
    std::vector<std::size_t> indices;
    for (const std::size_t other : others) indices.push_back(apart_[light][other]);
    return pictures(tensors_->displays(), indices, window);
  };
  if (gradients_.defined()) example.gradients = gradients_without(light, example.truth, window);
  return example;
}

// The query's own light must not be part of what its picture is made from.
Tensor CapturedScan::gradients_without(std::size_t light, const Tensor& picture, const Window& window) const {
  std::vector<float> shares;
  for (const std::vector<core::Vec3>& gradient : gradient_weights_) {
    const core::Vec3 share = gradient[light];
    shares.insert(shares.end(), {float(share.x), float(share.y), float(share.z)});
  }
  const Tensor own = torch::tensor(shares).view({2, 3, 1, 1}) * picture.pow(core::kDisplayGamma);
  return (pictures(gradients_, {0, 1}, window).pow(core::kDisplayGamma) - own)
      .clamp_min(0)
      .pow(1 / core::kDisplayGamma)
      .contiguous(at::MemoryFormat::ChannelsLast);
}

// As many of the lights around one, in another place than it, as can stand 1.4 to 2 spacings apart when they are tried in random order; nearest first.
std::vector<std::size_t> CapturedScan::thinned_lights(std::size_t light, std::size_t at_least,
                                                      std::mt19937_64& random) const {
  std::vector<std::size_t> around = apart_[light];
  around.resize(std::min(around.size(), kThinnedFrom));
  for (std::size_t i = around.size(); i > 1; --i) std::swap(around[i - 1], around[random() % i]);
  double apart = spacing_ * (1.4 + 0.6 * double(random() >> 11) * 0x1p-53);
  std::vector<std::size_t> kept;
  // Small stages keep more than would be left of them.
  for (; kept.size() < std::min(at_least, around.size()); apart *= 0.8) {
    kept.clear();
    for (const std::size_t candidate : around) {
      const auto too_near = [&](std::size_t other) {
        return angle_radians(directions_[candidate], directions_[other]) < apart;
      };
      if (std::none_of(kept.begin(), kept.end(), too_near)) kept.push_back(candidate);
    }
  }
  std::vector<core::Direction> directions;
  for (const std::size_t index : kept) directions.push_back(directions_[index]);
  std::vector<std::size_t> sorted;
  for (const std::size_t i : core::nearest_indices(directions, directions_[light], kept.size()))
    sorted.push_back(kept[i]);
  return sorted;
}

Example CapturedScan::thinned_example(std::size_t light, std::size_t count, std::mt19937_64& random,
                                      const Window& window) const {
  const std::vector<std::size_t> stage = thinned_lights(light, count, random);
  std::vector<core::Direction> directions;
  for (const std::size_t index : stage) directions.push_back(directions_[index]);
  const std::vector<double> w = RadialBasisWeights(directions)(directions_[light]);
  const Tensor weights = torch::tensor(w, torch::kFloat64).to(torch::kFloat32).view({-1, 1, 1, 1});
  const Tensor seen = pictures(tensors_->displays(), stage, window);

  Example example;
  example.query = directions_[light];
  const std::size_t active = std::min(count, stage.size());
  example.lights.assign(directions.begin(), directions.begin() + std::ptrdiff_t(active));
  example.spacing = core::median_spacing_radians(directions);
  example.images = seen.narrow(0, 0, std::int64_t(active)).contiguous(at::MemoryFormat::ChannelsLast);
  example.guide = (weights * seen).sum(0, true).clamp(0, Network::kBrightestInput);
  example.truth = pictures(tensors_->displays(), {light}, window);
  example.mask = cut(tensors_->mask(), window).unsqueeze(0);
  return example;
}

class CapturedData : public TrainingData {
 public:
  CapturedData(std::span<const core::OlatScan> scans, const TrainOptions& options, int multiple)
      : seed_(options.seed),
        neighbours_(std::size_t(options.config.neighbours)),
        active_set_(active_set_choice(options)),
        crop_(std::max(options.crop / multiple, 1) * multiple) {
    for (const core::OlatScan& scan : scans) {
      scans_.emplace_back(scan, options, multiple);
    }
  }

  Example training_draw(std::int64_t number) override {
    std::mt19937_64 random = draw_generator(seed_, Stream::kTraining, number);
    const CapturedScan& scan = scans_[random() % scans_.size()];
    const std::size_t light = scan.training_lights()[random() % scan.training_lights().size()];
    const Window window = scan.window_around(random(), crop_);
    if (active_set_ == ActiveSetChoice::kThinned) return scan.thinned_example(light, neighbours_, random, window);
    return scan.example(light,
                        active_set_ == ActiveSetChoice::kRandom
                            ? random_subset(scan.candidates(light), neighbours_, random)
                            : nearest(scan, light),
                        window);
  }

  int validation_count() const override { return std::max(kValidationDraws, int(scans_.size())); }

  Example validation_draw(int number) override {
    std::mt19937_64 random = draw_generator(seed_, Stream::kValidation, number);
    const std::size_t turn = std::size_t(number) / scans_.size();
    const CapturedScan& scan = scans_[std::size_t(number) % scans_.size()];
    const std::size_t light = scan.validation_lights()[turn % scan.validation_lights().size()];
    const Window window = scan.window_around(random(), crop_);
    if (active_set_ == ActiveSetChoice::kThinned) return scan.thinned_example(light, neighbours_, random, window);
    return scan.example(light, nearest(scan, light), window);
  }

 private:
  std::vector<std::size_t> nearest(const CapturedScan& scan, std::size_t light) const {
    std::vector<std::size_t> active = scan.candidates(light);
    active.resize(std::min(active.size(), neighbours_));
    return active;
  }

  std::vector<CapturedScan> scans_;
  std::uint64_t seed_;
  std::size_t neighbours_;
  ActiveSetChoice active_set_;
  int crop_;
};

}  // namespace

std::unique_ptr<TrainingData> captured_data(std::span<const core::OlatScan> scans, const TrainOptions& options,
                                            int multiple) {
  return std::make_unique<CapturedData>(scans, options, multiple);
}

}  // namespace lightstage::model
