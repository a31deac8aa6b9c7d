// Training xu, xu_adaptive and meka: that they learn, go on where they stopped, and use no other's weights.
#include <catch2/catch.hpp>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>

#include "core/error.h"
#include "core/file.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/classical.h"
#include "model/methods.h"
#include "model/metrics.h"
#include "model/net/light_selection.h"
#include "model/net/safetensors.h"
#include "model/synthetic_scan.h"
#include "model/training.h"
#include "support/support.h"

namespace lightstage {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;
using core::Direction;
using model::Architecture;

const auto kAll = {Architecture::kXu, Architecture::kXuAdaptive, Architecture::kMeka};

core::OlatScan ball(std::size_t lights = 40, int size = 16) {
  return test::scan_of(core::fibonacci_directions(lights), {size, size, 3}, test::matt_ball({size, size, 3}));
}

model::TrainOptions short_run(Architecture architecture, std::int64_t steps) {
  model::TrainOptions options;
  options.config = {.architecture = architecture, .neighbours = 4, .channels = {8, 16}, .query_channels = {8}};
  if (architecture == Architecture::kMeka) {
    options.config.neighbours = 2;
    options.config.query_channels.clear();
  }
  options.crop = 16;
  options.candidates = 8;
  options.steps = steps;
  options.validate_every = int(std::max<std::int64_t>(steps / 4, 1));
  options.learning_rate = 0.004;
  return options;
}

struct Fixture {
  Fixture() {
    core::set_quiet(true);
    core::set_thread_count(1);
  }
  ~Fixture() {
    core::set_quiet(false);
    core::set_thread_count(0);
  }

  model::TrainReport train(const model::TrainOptions& options, const fs::path& out,
                           const core::OlatScan& scan = ball()) const {
    return model::train(std::span(&scan, 1), options, out);
  }

  test::TemporaryFolder folder;
};

// [rows, candidates] of a checkpoint of xu.
std::vector<float> sampling_logits(const fs::path& checkpoint) {
  for (const auto& tensor : model::read_safetensors_header(checkpoint).tensors) {
    if (tensor.info.name == "sampling.logits") return model::read_tensor(checkpoint, tensor);
  }
  FAIL("no sampling.logits");
  return {};
}

}  // namespace

TEST_CASE_METHOD(Fixture, "each learns to light a ball better than its mean picture and its nearest light do") {
  const core::OlatScan scan = ball();
  const auto architecture = GENERATE(values(kAll));
  CAPTURE(model::architecture_name(architecture));
  const fs::path out = folder / "net.safetensors";
  const model::TrainReport report = train(short_run(architecture, 1000), out, scan);
  CHECK(report.best_validation < 0.8 * report.curve.front().validation);

  const auto network = model::make_interpolator(model::architecture_name(architecture), scan, {.model_file = out});
  const auto nearest = model::make_nearest(scan);
  const core::ImageSize size = scan.image_size();
  core::Image mean(size);
  for (std::size_t i = 0; i < scan.light_count(); ++i) {
    for (std::size_t v = 0; v < mean.values().size(); ++v) {
      mean.values()[v] += scan.image(i)->values()[v] / float(scan.light_count());
    }
  }
  double error = 0, mean_error = 0, nearest_error = 0;
  for (const Direction& query : core::random_directions(30, 4)) {
    const core::Image truth = test::picture_of(size, query, test::matt_ball(size));
    const auto difference = [&](const core::Image& picture) {
      double sum = 0;
      for (std::size_t v = 0; v < truth.values().size(); ++v) {
        sum += std::abs(double(picture.values()[v]) - truth.values()[v]);
      }
      return sum;
    };
    error += difference(network->render(query));
    mean_error += difference(mean);
    nearest_error += difference(nearest->render(query));
  }
  CAPTURE(error, mean_error, nearest_error);
  CHECK(error < 0.5 * mean_error);
  if (architecture == Architecture::kXuAdaptive) CHECK(error < nearest_error);
}

TEST_CASE_METHOD(Fixture,
                 "xu ends with one light a picture, all different, and they stand firm while the picture is learnt") {
  model::TrainOptions options = short_run(Architecture::kXu, 300);
  train(options, folder / "net.safetensors");
  const std::vector<float> last = sampling_logits(folder / "net.last.safetensors");
  const std::size_t columns = model::sampling_candidates().size();
  REQUIRE(last.size() == 4 * columns);
  // Candidates that mean the same light of a stage are as good as each other.
  const std::vector<std::size_t> lights = model::nearest_to_candidates(ball().directions());
  const double sharpness = *model::selection_sharpness(0.333);
  for (std::size_t row = 0; row < 4; ++row) {
    const std::span logits(last.data() + row * columns, columns);
    const double best = *std::max_element(logits.begin(), logits.end());
    std::vector<double> shares(40);
    for (std::size_t i = 0; i < columns; ++i) shares[lights[i]] += std::exp(sharpness * (logits[i] - best));
    CAPTURE(row);
    CHECK(*std::max_element(shares.begin(), shares.end()) > 0.95 * std::accumulate(shares.begin(), shares.end(), 0.0));
  }
  const auto chosen = model::chosen_candidates(last, 4);
  CHECK(std::set<std::size_t>(chosen.begin(), chosen.end()).size() == 4);

  // A third of the run moved them.
  const auto state =
      nlohmann::json::parse(model::read_safetensors_header(folder / "net.safetensors.state").metadata.at("state"));
  CHECK(state.at("adam_steps").at("sampling.logits") == 100);
  CHECK(state.at("adam_steps").at("output.conv.bias") == 300);
}

TEST_CASE_METHOD(Fixture, "xu that is trained on keeps its lights") {
  model::TrainOptions options = short_run(Architecture::kXu, 30);
  train(options, folder / "first");
  options.start_from = folder / "first";
  train(options, folder / "second");
  CHECK(sampling_logits(folder / "second.last.safetensors") == sampling_logits(folder / "first"));
  CHECK(core::read_text_file(folder / "second.last.safetensors") != core::read_text_file(folder / "first"));
}

TEST_CASE_METHOD(Fixture, "they are resumed with the same bits, and their files are read back as written") {
  const auto architecture = GENERATE(values(kAll));
  CAPTURE(model::architecture_name(architecture));
  model::TrainOptions options = short_run(architecture, 60);
  options.validate_every = 10;
  model::SimulatedViews views;
  views.count = 6;
  views.description = "{}";
  int left = 1 << 30;  // draws of views before one cannot be made
  views.make = [&](std::size_t index) {
    if (left-- == 0) throw core::BadInput("no view");
    model::TruthView view{ball(20 + 5 * index), core::random_directions(6, index), {}};
    for (const Direction& query : view.queries) {
      view.truth.push_back(test::picture_of({16, 16, 3}, query, test::matt_ball({16, 16, 3})));
    }
    return view;
  };
  model::train(views, options, folder / "whole");

  left = 5;  // four for validation, and the first of training
  CHECK_THROWS_WITH(model::train(views, options, folder / "parts"), "no view");
  left = 1 << 30;
  options.resume = folder / "parts";
  model::train(views, options, folder / "parts");
  CHECK(core::read_text_file(folder / "parts") == core::read_text_file(folder / "whole"));
  CHECK(core::read_text_file(folder / "parts.last.safetensors") ==
        core::read_text_file(folder / "whole.last.safetensors"));
}

TEST_CASE_METHOD(Fixture, "methods refuse each other's checkpoints and what no run of theirs can have") {
  const core::OlatScan scan = ball();
  for (const Architecture architecture : kAll) {
    const fs::path file = folder / std::string(model::architecture_name(architecture));
    train(short_run(architecture, 1), file);
    for (const Architecture method : model::kArchitectures) {
      const auto make = [&] { model::make_interpolator(model::architecture_name(method), scan, {.model_file = file}); };
      if (method == architecture) {
        CHECK_NOTHROW(make());
      } else {
        CHECK_THROWS_WITH(make(),
                          Contains("is a model for --method " + std::string(model::architecture_name(architecture))));
      }
    }
    CHECK_THROWS_WITH(model::make_interpolator(model::architecture_name(architecture), scan),
                      Contains("needs a model"));
    const auto info = model::read_checkpoint_info(file);
    CHECK(info.config == short_run(architecture, 1).config);

    model::TrainOptions options = short_run(architecture, 1);
    options.progressive = true;
    CHECK_THROWS_AS(train(options, folder / "no"), core::UsageError);
    options = short_run(architecture, 1);
    options.start_from = folder / "other";
    train(short_run(architecture == Architecture::kMeka ? Architecture::kXu : Architecture::kMeka, 1),
          *options.start_from);
    CHECK_THROWS_WITH(train(options, folder / "no"), Contains("another configuration"));
    fs::remove(folder / "other");
    fs::remove(folder / "other.last.safetensors");
  }
  for (const Architecture architecture : {Architecture::kXu, Architecture::kMeka}) {
    model::TrainOptions options = short_run(architecture, 1);
    options.active_set = model::ActiveSetChoice::kRandom;
    CHECK_THROWS_WITH(train(options, folder / "no"), Contains("no active set"));
  }
}

TEST_CASE_METHOD(Fixture, "a loss that is not finite stops them, and the last good weights stay") {
  const auto architecture = GENERATE(values(kAll));
  model::TrainOptions options = short_run(architecture, 50);
  options.learning_rate = 1e30;
  const model::TrainReport report = train(options, folder / "net.safetensors");
  CHECK(report.stopped_by_nan);
  CHECK(report.steps < 50);
  CHECK_NOTHROW(model::make_interpolator(model::architecture_name(architecture), ball(),
                                         {.model_file = folder / "net.safetensors"})
                    ->render(Direction()));
}

}  // namespace lightstage
