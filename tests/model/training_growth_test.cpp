// What a training run offers beyond learning: growth from coarse to fine, runs on simulated views, ablations, and the files it leaves.
#include <csignal>

#include <catch2/catch.hpp>
#include <map>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/net/loss_curve.h"
#include "model/net/progressive.h"
#include "model/net/safetensors.h"
#include "model/synthetic_scan.h"
#include "model/training.h"
#include "support/support.h"

namespace lightstage {
namespace {

namespace fs = std::filesystem;
using core::Direction;
using Numbers = std::map<std::string, std::vector<float>>;

core::OlatScan ball(int size, std::size_t lights) {
  const core::ImageSize image_size{size, size, 3};
  return test::scan_of(core::fibonacci_directions(lights), image_size, test::matt_ball(image_size));
}

// A ball between whose lights the truth is known.
model::SimulatedViews balls(int size) {
  model::SimulatedViews views;
  views.count = 12;
  views.description = R"({"views":12})";
  views.make = [size](std::size_t index) {
    const core::ImageSize image_size{size, size, 3};
    model::TruthView view{ball(size, 25 + index), core::random_directions(6, index), {}};
    for (const Direction& query : view.queries) {
      view.truth.push_back(test::picture_of(image_size, query, test::matt_ball(image_size)));
    }
    return view;
  };
  return views;
}

model::TrainOptions short_run(std::int64_t steps) {
  model::TrainOptions options;
  options.config = {.neighbours = 4, .channels = {8, 12}, .query_channels = {8}};
  options.crop = 16;
  options.candidates = 8;
  options.steps = steps;
  options.validate_every = 5;
  return options;
}

model::TrainOptions short_blend_run(std::int64_t steps) {
  model::TrainOptions options = short_run(steps);
  options.config.architecture = model::Architecture::kBlend;
  options.config.query_channels.clear();
  return options;
}

model::TrainReport train(const core::OlatScan& scan, const model::TrainOptions& options, const fs::path& out) {
  return model::train(std::span(&scan, 1), options, out);
}

Numbers numbers_of(const fs::path& path) {
  Numbers numbers;
  for (const auto& tensor : model::read_safetensors_header(path).tensors) {
    numbers[tensor.info.name] = model::read_tensor(path, tensor);
  }
  return numbers;
}

nlohmann::json provenance_of(const fs::path& checkpoint) {
  return nlohmann::json::parse(model::read_checkpoint_info(checkpoint).provenance);
}

struct Quiet {
  Quiet() { core::set_quiet(true); }
  ~Quiet() { core::set_quiet(false); }
};

struct OneThread {
  OneThread() { core::set_thread_count(1); }
  ~OneThread() { core::set_thread_count(0); }
};

}  // namespace

TEST_CASE("the weights of levels are the published ones, sum to 1, and end with the finest alone") {
  for (const int levels : {1, 2, 4, 7, 8}) {
    for (int i = 0; i <= 1000; ++i) {
      const double fraction = i / 1000.0;
      const double position = model::level_position(fraction, levels);
      double sum = 0;
      std::map<int, double> weights;
      for (const auto& [level, weight] : model::active_levels(position)) {
        CHECK(weight > 0);
        CHECK((level >= 0 && level < levels));
        weights[level] = weight;
        sum += weight;
      }
      CHECK(sum == Approx(1).margin(1e-12));
      // a_d(t) as published, from where the coarsest level has faded in.
      if (levels * (1 - fraction) > levels - 1) {
        CHECK(weights == std::map<int, double>{{levels - 1, 1.0}});
        continue;
      }
      for (int d = 0; d < levels; ++d) {
        const double published = std::max(0.0, 1 - std::abs(levels * (1 - fraction) - d));
        CHECK((weights.contains(d) ? weights[d] : 0.0) == Approx(published).margin(1e-12));
      }
    }
    const auto last = model::active_levels(model::level_position(1, levels));
    REQUIRE(last.size() == 1);
    CHECK(last[0].level == 0);
    CHECK(last[0].weight == 1);
    CHECK(model::last_stage(model::level_position(1, levels)) == 1);
    CHECK(model::last_stage(model::level_position(0, levels)) == (levels == 1 ? 1 : 0));
    CHECK(model::active_levels(model::level_position(2, levels))[0].level == 0);  // time that ran out during a step
  }
}

TEST_CASE("a network that grows learns every level, and its last pictures are full-size ones") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = ball(16, 40);
  model::TrainOptions options = short_run(1);
  train(scan, options, folder / "first");
  options.steps = 200;
  options.validate_every = 20;
  options.learning_rate = 4e-3;
  const model::TrainReport report = train(scan, options, folder / "net");

  REQUIRE(report.curve.size() == 10);
  CHECK(report.curve.front().level == 1);  // the coarsest of two levels alone
  CHECK(report.curve[6].level == Approx(0.6));
  CHECK(report.curve.back().level == 0);
  const auto before = model::read_checkpoint_info(folder / "first"),
             after = model::read_checkpoint_info(folder / "net");
  CHECK(report.best_validation < 0.6 * provenance_of(folder / "first").at("validation_l1").get<double>());
  CHECK(provenance_of(folder / "net").at("progressive") == true);
  CHECK(before.config == after.config);

  const Numbers start = numbers_of(folder / "first.last.safetensors"),
                end = numbers_of(folder / "net.last.safetensors");
  for (const auto& [name, values] : end) CHECK((start.at(name) != values));
}

TEST_CASE("a level that is not active is left alone") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = ball(16, 30);
  model::TrainOptions options = short_run(1);  // at the coarsest level
  options.learning_rate = 0.1;
  train(scan, options, folder / "one");
  options.learning_rate = 1e-30;
  train(scan, options, folder / "none");
  const Numbers trained = numbers_of(folder / "one.last.safetensors"),
                start = numbers_of(folder / "none.last.safetensors");
  for (const char* active :
       {"inject.1.conv.weight", "output.1.conv.weight", "encoder.1.conv.weight", "query.0.weight"}) {
    CHECK((trained.at(active) != start.at(active)));
  }
  for (const char* idle :
       {"encoder.0.conv.weight", "decoder.0.conv.weight", "output.0.conv.weight", "encoder.0.slope"}) {
    CHECK((trained.at(idle) == start.at(idle)));
  }
}

TEST_CASE("a run on simulated views that is interrupted and resumed ends with the same bits, growing or not") {
  const Quiet quiet;
  const OneThread one_thread;
  for (model::TrainOptions options : {short_run(90), short_blend_run(90)}) {
    const test::TemporaryFolder folder;
    const model::SimulatedViews views = balls(16);
    const model::TrainReport expected = model::train(views, options, folder / "whole");

    model::SimulatedViews interrupted = views;
    interrupted.make = [&](std::size_t index) {
      if (index >= 8) std::raise(SIGINT);  // the fifth view to train on, some time after step 25
      return views.make(index);
    };
    {
      const core::InterruptGuard guard;
      CHECK_THROWS_AS(model::train(interrupted, options, folder / "parts"), core::Interrupted);
    }
    options.resume = folder / "parts";
    const model::TrainReport resumed = model::train(views, options, folder / "end");
    CHECK(resumed.steps == expected.steps);
    REQUIRE(resumed.curve.size() == expected.curve.size());
    for (std::size_t i = 0; i < expected.curve.size(); ++i) {
      CHECK(resumed.curve[i].step == expected.curve[i].step);
      CHECK(resumed.curve[i].train == expected.curve[i].train);
      CHECK(resumed.curve[i].validation == expected.curve[i].validation);
      CHECK(resumed.curve[i].level == expected.curve[i].level);
    }
    CHECK(core::read_text_file(folder / "end") == core::read_text_file(folder / "whole"));
    CHECK((numbers_of(folder / "end.state") == numbers_of(folder / "whole.state")));
  }
}

TEST_CASE("a run without progress stops early, and not before full-size pictures are trained") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = ball(16, 30);
  model::TrainOptions options = short_run(100);
  options.learning_rate = 1e-30;  // no weight moves
  options.early_stop = 2;
  options.progressive = false;
  const model::TrainReport still = train(scan, options, folder / "still");
  CHECK(still.stopped_early);
  CHECK(still.steps == 15);  // the first validation is the best so far, the two after it are not better
  options.progressive = true;
  const model::TrainReport growing = train(scan, options, folder / "growing");
  CHECK(growing.stopped_early);
  CHECK(growing.steps == 65);  // full-size pictures come in after step 50
  options.early_stop = 0;
  options.steps = 30;
  CHECK_FALSE(train(scan, options, folder / "never").stopped_early);
}

TEST_CASE("the sharpness follows its own rate, and can be frozen") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = ball(16, 30);
  const auto change = [&](double rate) {
    model::TrainOptions options = short_run(4);
    options.sharpness_rate = rate;
    const std::string name = "rate" + std::to_string(rate);
    train(scan, options, folder / name);
    const double end = numbers_of(folder / (name + ".last.safetensors")).at("log_sharpness").at(0);
    return std::abs(end - std::log(options.config.sharpness));
  };
  const double full = change(1), tenth = change(0.1);
  CHECK(change(0) < 1e-7);
  CHECK(tenth > 1e-6);
  // Adam's steps are about the learning rate, whatever the gradient.
  CHECK(full / tenth == Approx(10).epsilon(0.2));
}

TEST_CASE("ablations are recorded, and train on other neighbours or another pooling") {
  const Quiet quiet;
  const OneThread one_thread;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = ball(16, 30);
  model::TrainOptions options = short_run(10);
  const model::TrainReport random = train(scan, options, folder / "random");
  options.active_set = model::ActiveSetChoice::kNaive;
  const model::TrainReport naive = train(scan, options, folder / "naive");
  options.config.pooling = model::Pooling::kAverage;
  const model::TrainReport average = train(scan, options, folder / "average");
  CHECK(random.curve[0].train != naive.curve[0].train);
  CHECK(naive.curve[0].train != average.curve[0].train);
  CHECK(provenance_of(folder / "random").at("active_set") == "random");
  CHECK(provenance_of(folder / "naive").at("active_set") == "naive");
  CHECK(provenance_of(folder / "average").at("config").at("pooling") == "average");
  CHECK(model::read_checkpoint_info(folder / "average").config == options.config);
  CHECK(numbers_of(folder / "average.last.safetensors").at("log_sharpness").at(0) ==
        float(std::log(options.config.sharpness)));  // nothing depends on it
}

TEST_CASE("training goes on from another network's weights, at full size, and refuses one of another configuration") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  model::train(balls(16), short_run(40), folder / "general");
  model::TrainOptions options = short_run(1);
  options.start_from = folder / "general";
  options.learning_rate = 1e-30;
  const core::OlatScan scan = ball(20, 35);
  train(scan, options, folder / "adapted");
  const Numbers general = numbers_of(folder / "general"), adapted = numbers_of(folder / "adapted.last.safetensors");
  for (const auto& [name, values] : general) {
    for (std::size_t i = 0; i < values.size(); ++i) CHECK(adapted.at(name).at(i) == Approx(values[i]).margin(1e-20));
  }
  CHECK(provenance_of(folder / "adapted").at("start_from").at("file") == "general");
  CHECK(provenance_of(folder / "adapted").at("start_from").at("provenance") == provenance_of(folder / "general"));
  CHECK(provenance_of(folder / "adapted").at("progressive") == false);

  // And learns on: the scan's own validation error falls.
  options.steps = 60;
  options.learning_rate = 1e-3;
  options.validate_every = 10;
  const double before = provenance_of(folder / "adapted").at("validation_l1").get<double>();
  CHECK(train(scan, options, folder / "on").best_validation < before);

  options.config.channels = {8, 16};
  CHECK_THROWS_AS(train(scan, options, folder / "other"), core::UsageError);
  options.start_from = folder / "nowhere";
  CHECK_THROWS_AS(train(scan, options, folder / "other"), core::BadInput);
  CHECK_FALSE(fs::exists(folder / "other"));
}

TEST_CASE("a run leaves the best and the last weights, and its curve as numbers and as a picture") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const model::TrainReport report = train(ball(16, 30), short_run(20), folder / "net.safetensors");
  const fs::path last = folder / "net.last.safetensors";
  CHECK(model::last_checkpoint_path(folder / "net.safetensors") == last);
  CHECK(model::last_checkpoint_path(folder / "net") == last);
  CHECK(model::last_checkpoint_path(folder / "net.v2") == folder / "net.v2.last.safetensors");

  const Numbers state = numbers_of(folder / "net.safetensors.state"), weights = numbers_of(last);
  for (const auto& [name, values] : weights) CHECK((state.at("weight/" + name) == values));
  CHECK(provenance_of(last).at("validation_l1") == report.curve.back().validation);
  CHECK(provenance_of(last).at("steps") == 20);
  CHECK(provenance_of(folder / "net.safetensors").at("validation_l1") == report.best_validation);

  const core::Image picture = core::read_image(folder / "net.safetensors.png");
  const auto darkest = *std::min_element(picture.values().begin(), picture.values().end());
  CHECK(picture.width() > 600);
  CHECK(darkest < 0.1f);
  const std::string csv = core::read_text_file(folder / "net.safetensors.csv");
  CHECK(csv.starts_with("step,seconds,train_l1,validation_l1,level\n0,0,,"));
  CHECK(std::count(csv.begin(), csv.end(), '\n') == 2 + std::ptrdiff_t(report.curve.size()));
}

TEST_CASE("the picture of a curve is drawn whatever the numbers") {
  const double nan = std::nan("");
  const auto point = [](std::int64_t step, double train, double validation) {
    return model::LossPoint{step, 1, train, validation, 0};
  };
  const auto dark_pixels = [](const std::vector<model::LossPoint>& curve, double guide) {
    const core::Image picture = model::draw_loss_curve(curve, guide, guide);
    return std::count_if(picture.values().begin(), picture.values().end(), [](float v) { return v < 0.5f; });
  };
  const auto axes = dark_pixels({}, nan);
  CHECK(axes > 1000);
  CHECK(dark_pixels({point(1, nan, 0), point(2, -1, nan)}, 0) > 1000);
  CHECK(dark_pixels({point(1, 0.03, 0.03)}, 0.03) > axes);
  CHECK(dark_pixels({point(1, 1e-30, 1e30), point(1'000'000'000, 1e-30, 1e30)}, 1) > axes);
  CHECK(dark_pixels({point(10, 0.1, 0.01), point(1000, 0.1, 0.01)}, nan) > axes + 1000);  // two long lines
}

TEST_CASE("a run on simulated views whose loss is not finite keeps the last good weights") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  model::TrainOptions options = short_blend_run(100);
  options.learning_rate = 1e38;
  const model::TrainReport report = model::train(balls(16), options, folder / "net");
  CHECK(report.stopped_by_nan);
  CHECK(report.steps < 100);
  for (const auto& [name, values] : numbers_of(folder / "net")) {
    for (const float value : values) CHECK(std::abs(value) < 1e3);
  }
}

TEST_CASE("pictures of one pixel, of three columns and of prime sizes can be trained on") {
  const Quiet quiet;
  const auto shade = [](const Direction& l, int y, int x, int) {
    return 0.6 + 0.4 * std::sin(y + 3 * l.x() + x * l.y());
  };
  for (const core::ImageSize size : {core::ImageSize{1, 1, 3}, {41, 3, 3}, {31, 29, 1}}) {
    for (const auto& options : {short_run(6), short_blend_run(6)}) {
      const test::TemporaryFolder folder;
      const model::TrainReport report =
          train(test::scan_of(core::fibonacci_directions(20), size, shade), options, folder / "net");
      CHECK_FALSE(report.stopped_by_nan);
      CHECK(std::isfinite(report.curve.back().validation));
    }
  }
}

TEST_CASE("options of training that make no sense are refused before anything is written") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const auto refused = [&](model::TrainOptions options) {
    CHECK_THROWS_AS(train(ball(16, 30), options, folder / "net"), core::UsageError);
    CHECK(fs::is_empty(folder.path()));
  };
  model::TrainOptions options = short_blend_run(5);
  options.progressive = true;
  refused(options);
  options = short_run(5);
  options.sharpness_rate = -1;
  refused(options);
  options.sharpness_rate = std::nan("");
  refused(options);
  options = short_run(5);
  options.early_stop = -1;
  refused(options);
}

}  // namespace lightstage
