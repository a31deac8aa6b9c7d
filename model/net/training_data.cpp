#include "model/net/training_data.h"

#include <algorithm>
#include <random>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/sphere.h"
#include "model/classical/thin_plate.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr double kSamePlace = 1e-4;  // radians, as for the thin-plate weights
constexpr std::size_t kGuideLights =
    256;  // farther ones weigh next to nothing, and the system is cubic in their number
constexpr std::size_t kLightsPerHeldOut = 16;
constexpr int kValidationDraws = 24;

enum class Stream : std::uint32_t { kTraining, kValidation };

std::mt19937_64 generator(std::uint64_t seed, Stream stream, std::int64_t number) {
  const auto low = [](std::uint64_t v) { return std::uint32_t(v); };
  const auto high = [](std::uint64_t v) { return std::uint32_t(v >> 32); };
  std::seed_seq sequence{low(seed), high(seed), std::uint32_t(stream), low(std::uint64_t(number)),
                         high(std::uint64_t(number))};
  return std::mt19937_64(sequence);
}

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

Tensor index_tensor(const std::vector<std::size_t>& indices) {
  return torch::tensor(std::vector<std::int64_t>(indices.begin(), indices.end()));
}

}  // namespace

TrainingScan::TrainingScan(const core::OlatScan& scan, int neighbours, int candidates, int multiple)
    : directions_(scan.directions()), spacing_(core::median_spacing_radians(scan.directions())) {
  const std::size_t lights = directions_.size();
  if (lights < std::size_t(neighbours) + 1) {
    throw core::UsageError("scan '" + scan.name() + "' has " + std::to_string(lights) + " lights; training with " +
                           std::to_string(neighbours) + " neighbours needs at least " + std::to_string(neighbours + 1));
  }
  choose_neighbours(candidates);
  if (std::any_of(candidates_.begin(), candidates_.end(), [](const auto& c) { return c.empty(); })) {
    throw core::UsageError("scan '" + scan.name() + "' has all its lights in one place; there is nothing to train on");
  }
  for (std::size_t light = 0; light < lights; ++light) {
    const bool held_out = light % kLightsPerHeldOut == std::min(kLightsPerHeldOut, lights) / 2;
    (held_out ? validation_lights_ : training_lights_).push_back(light);
  }
  load(scan, bounding_window(scan.mask()), multiple);
  interpolate_guides();
}

void TrainingScan::choose_neighbours(int candidates) {
  for (const core::Direction& light : directions_) {
    std::vector<std::size_t> others = core::nearest_indices(directions_, light, directions_.size());
    std::erase_if(others, [&](std::size_t other) { return angle_radians(light, directions_[other]) < kSamePlace; });
    candidates_.emplace_back(others.begin(),
                             others.begin() + std::ptrdiff_t(std::min(others.size(), std::size_t(candidates))));
    apart_.push_back(std::move(others));
  }
}

void TrainingScan::load(const core::OlatScan& scan, const Window& mask_window, int multiple) {
  const Window window = rounded_up(mask_window, multiple);
  mask_ = torch::zeros({1, window.height, window.width});
  float* const inside = mask_.data_ptr<float>();
  for (int y = 0; y < mask_window.height; ++y) {
    for (int x = 0; x < mask_window.width; ++x) {
      if (!(scan.mask()(mask_window.y + y, mask_window.x + x) > 0.5f)) continue;
      masked_pixels_.emplace_back(y, x);
      inside[y * window.width + x] = 1;
    }
  }
  const double exposure = scan.exposure();
  displays_ =
      torch::empty({std::int64_t(directions_.size()), 3, window.height, window.width}, at::MemoryFormat::ChannelsLast);
  for (std::size_t light = 0; light < directions_.size(); ++light) {
    core::throw_if_interrupted();
    displays_[std::int64_t(light)].copy_(
        cut(to_display(*scan.image(light), exposure), window).clamp_max(Network::kBrightestInput));
  }
}

void TrainingScan::interpolate_guides() {
  const std::int64_t lights = displays_.size(0);
  Tensor weights = torch::zeros({lights, lights});
  for (std::int64_t light = 0; light < lights; ++light) {
    core::throw_if_interrupted();
    std::vector<std::size_t> used = apart_[std::size_t(light)];
    used.resize(std::min(used.size(), kGuideLights));
    std::vector<core::Direction> directions;
    for (const std::size_t index : used) directions.push_back(directions_[index]);
    const std::vector<double> w = ThinPlateWeights(directions)(directions_[std::size_t(light)]);
    float* const row = weights.data_ptr<float>() + light * lights;
    for (std::size_t i = 0; i < used.size(); ++i) row[used[i]] = float(w[i]);
  }
  const Tensor rows = displays_.permute({0, 2, 3, 1}).reshape({lights, -1});
  const std::int64_t height = displays_.size(2), width = displays_.size(3);
  guides_ = torch::matmul(weights, rows)
                .clamp_(0, Network::kBrightestInput)
                .view({lights, height, width, 3})
                .permute({0, 3, 1, 2});
}

Window TrainingScan::window_around(std::uint64_t anchor, int size) const {
  const int height = int(mask_.size(1)), width = int(mask_.size(2));
  const auto [y, x] = masked_pixels_[std::size_t(anchor % masked_pixels_.size())];
  const int h = std::min(size, height), w = std::min(size, width);
  return {std::clamp(y - h / 2, 0, height - h), std::clamp(x - w / 2, 0, width - w), h, w};
}

Example TrainingScan::example(std::size_t light, std::vector<std::size_t> active, const Window& window) const {
  const auto one = [&](const Tensor& images) {
    return cut(images.narrow(0, std::int64_t(light), 1), window).contiguous(at::MemoryFormat::ChannelsLast);
  };
  Example example;
  example.query = directions_[light];
  example.lights = directions_;
  example.spacing = spacing_;
  example.images =
      cut(displays_, window).index_select(0, index_tensor(active)).contiguous(at::MemoryFormat::ChannelsLast);
  example.guide = one(guides_);
  example.truth = one(displays_);
  example.mask = cut(mask_, window).unsqueeze(0);
  example.active = std::move(active);
  return example;
}

TrainingData::TrainingData(std::span<const core::OlatScan> scans, const TrainOptions& options, int multiple)
    : seed_(options.seed),
      neighbours_(options.config.neighbours),
      crop_(std::max(options.crop / multiple, 1) * multiple) {
  for (const core::OlatScan& scan : scans) scans_.emplace_back(scan, neighbours_, options.candidates, multiple);
}

Example TrainingData::training_draw(std::int64_t number) const {
  std::mt19937_64 random = generator(seed_, Stream::kTraining, number);
  const TrainingScan& scan = scans_[random() % scans_.size()];
  const std::size_t light = scan.training_lights()[random() % scan.training_lights().size()];
  std::vector<std::size_t> active = random_subset(scan.candidates(light), std::size_t(neighbours_), random);
  return scan.example(light, std::move(active), scan.window_around(random(), crop_));
}

int TrainingData::validation_count() const {
  return std::max(kValidationDraws, int(scans_.size()));
}

Example TrainingData::validation_draw(int number) const {
  std::mt19937_64 random = generator(seed_, Stream::kValidation, number);
  const std::size_t turn = std::size_t(number) / scans_.size();
  const TrainingScan& scan = scans_[std::size_t(number) % scans_.size()];
  const std::size_t light = scan.validation_lights()[turn % scan.validation_lights().size()];
  std::vector<std::size_t> active = scan.candidates(light);
  active.resize(std::min(active.size(), std::size_t(neighbours_)));
  return scan.example(light, std::move(active), scan.window_around(random(), crop_));
}

}  // namespace lightstage::model
