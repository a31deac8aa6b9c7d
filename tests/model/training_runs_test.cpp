// Training runs: that they learn, can be interrupted and repeated to the bit, and stop when the numbers go wrong.
#include <csignal>

#include <catch2/catch.hpp>
#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/light_list.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/net/safetensors.h"
#include "model/network_interpolator.h"
#include "model/synthetic_scan.h"
#include "model/training.h"
#include "support/support.h"

namespace lightstage {
namespace {

namespace fs = std::filesystem;
using core::Direction;

// A ball with a ridge that casts a hard shadow: brightness jumps where the light drops below the ridge.
core::OlatScan shadowed_ball(int size, std::size_t lights) {
  const core::ImageSize image_size{size, size, 3};
  const test::PixelFunction ball = test::matt_ball(image_size);
  const auto value = [=](const Direction& light, int y, int x, int c) {
    const double across = (2.0 * x + 1 - size) / size;
    const bool in_shadow = light.x() * across < -0.15 && std::abs(light.x()) > 0.6 * light.z();
    return ball(light, y, x, c) * (in_shadow ? 0.1 : 1.0);
  };
  return test::scan_of(core::fibonacci_directions(lights), image_size, value);
}

model::TrainOptions short_run(std::int64_t steps) {
  model::TrainOptions options;
  options.config = {
      .architecture = model::Architecture::kBlend, .neighbours = 4, .channels = {4, 8}, .query_channels = {}};
  options.crop = 16;
  options.candidates = 8;
  options.steps = steps;
  options.validate_every = 5;
  return options;
}

fs::path beside(const fs::path& checkpoint, const char* ending) {
  fs::path path = checkpoint;
  path += ending;
  return path;
}

// The current weights and Adam's moments of a run, which hold no times.
std::vector<std::vector<float>> state_numbers(const fs::path& checkpoint) {
  const fs::path path = beside(checkpoint, ".state");
  std::vector<std::vector<float>> numbers;
  for (const auto& tensor : model::read_safetensors_header(path).tensors)
    numbers.push_back(model::read_tensor(path, tensor));
  return numbers;
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

TEST_CASE("training beats interpolation on lights that it never saw as truth, and says so truly") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = shadowed_ball(24, 60);
  const OneThread one_thread;
  model::TrainOptions options = short_run(1000);
  options.config.channels = {8, 16, 16};
  options.crop = 24;
  options.validate_every = 250;
  const fs::path out = folder / "net.safetensors";
  const model::TrainReport report = model::train(std::span(&scan, 1), options, out);

  CHECK(report.steps == 1000);
  CHECK_FALSE(report.stopped_by_nan);
  REQUIRE(report.curve.size() == 4);
  CHECK(report.curve.back().step == 1000);
  CHECK(report.curve.back().validation < 0.95 * report.guide_validation);
  for (const auto& point : report.curve) CHECK(point.train > 0);

  const model::CheckpointInfo info = model::read_checkpoint_info(out);
  CHECK(info.parameters == report.parameters);
  double best = report.best_validation;
  for (const auto& point : report.curve) best = std::min(best, point.validation);
  const auto provenance = nlohmann::json::parse(info.provenance);
  CHECK(provenance.at("validation_l1").get<double>() == best);
  CHECK(provenance.at("data").at(0).at("name") == "synthetic");
  const std::string csv = core::read_text_file(beside(out, ".csv"));
  CHECK(std::count(csv.begin(), csv.end(), '\n') == 6);  // titles, the start and four points
}

TEST_CASE("a run that is interrupted and resumed ends with the same bits as one that is not") {
  const Quiet quiet;
  const OneThread one_thread;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = shadowed_ball(16, 30);
  const model::TrainOptions options = short_run(80);
  const fs::path whole = folder / "whole", parts = folder / "parts";
  const model::TrainReport expected = model::train(std::span(&scan, 1), options, whole);

  {
    // Ctrl-C as soon as the first point of the curve is on disk; this guard catches it should training be over by then.
    const core::InterruptGuard guard;
    std::thread operator_at_the_keyboard([&] {
      const auto lines = [&] {
        if (!fs::exists(beside(parts, ".csv"))) return std::ptrdiff_t(0);
        const std::string csv = core::read_text_file(beside(parts, ".csv"));
        return std::count(csv.begin(), csv.end(), '\n');
      };
      for (int i = 0; i < 20000 && lines() < 3; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      std::raise(SIGINT);
    });
    CHECK_THROWS_AS(model::train(std::span(&scan, 1), options, parts), core::Interrupted);
    operator_at_the_keyboard.join();
  }
  model::TrainOptions again = options;
  again.resume = parts;
  const fs::path end = folder / "end";
  const model::TrainReport resumed = model::train(std::span(&scan, 1), again, end);

  CHECK(resumed.steps == expected.steps);
  CHECK(resumed.guide_validation == expected.guide_validation);
  REQUIRE(resumed.curve.size() == expected.curve.size());
  for (std::size_t i = 0; i < expected.curve.size(); ++i) {
    CHECK(resumed.curve[i].step == expected.curve[i].step);
    CHECK(resumed.curve[i].train == expected.curve[i].train);
    CHECK(resumed.curve[i].validation == expected.curve[i].validation);
  }
  CHECK(core::read_text_file(end) == core::read_text_file(whole));
  CHECK(state_numbers(end) == state_numbers(whole));
}

TEST_CASE("another seed gives another network") {
  const Quiet quiet;
  const OneThread one_thread;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = shadowed_ball(16, 30);
  model::TrainOptions options = short_run(5);
  model::train(std::span(&scan, 1), options, folder / "a");
  options.seed = 2;
  model::train(std::span(&scan, 1), options, folder / "b");
  CHECK(state_numbers(folder / "a") != state_numbers(folder / "b"));
}

TEST_CASE("a loss that is not finite stops the run and leaves the last good checkpoint") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = shadowed_ball(16, 30);
  model::TrainOptions options = short_run(100);
  options.learning_rate = 1e38;  // weights overflow within a few steps
  const model::TrainReport report = model::train(std::span(&scan, 1), options, folder / "net");
  CHECK(report.stopped_by_nan);
  CHECK(report.steps < 100);
  const core::Image image = model::make_network_interpolator(scan, folder / "net")->render(Direction());
  for (const float value : image.values()) CHECK(std::isfinite(value));
}

TEST_CASE("a run bounded by time ends in time") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = shadowed_ball(16, 30);
  model::TrainOptions options = short_run(1000000);
  options.minutes = 1.0 / 60;
  const model::TrainReport report = model::train(std::span(&scan, 1), options, folder / "net");
  CHECK(report.steps > 0);
  CHECK(report.seconds >= 1);
  CHECK(report.curve.back().step == report.steps);
}

TEST_CASE("several scans, grey ones and ones with a mask train together") {
  const OneThread one_thread;
  const Quiet quiet;
  const test::TemporaryFolder folder;
  core::Image mask(9, 31, 1);
  for (int x = 3; x < 30; ++x) mask(4, x) = 1;
  const auto shade = [](const Direction& l, int y, int x, int) {
    return 0.6 + 0.4 * std::sin(y + 3 * l.x() + x * l.y());
  };
  const std::vector<core::OlatScan> scans{shadowed_ball(16, 30),
                                          test::scan_of(core::fibonacci_directions(17), {9, 31, 1}, shade, mask)};
  const model::TrainReport report = model::train(scans, short_run(12), folder / "net");
  CHECK(report.steps == 12);
  CHECK(std::isfinite(report.curve.back().validation));
}

TEST_CASE("runs that make no sense are refused before anything is written") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = shadowed_ball(16, 30);
  const auto refused = [&](const auto& change, const core::OlatScan& of) {
    model::TrainOptions options = short_run(5);
    change(options);
    CHECK_THROWS_AS(model::train(std::span(&of, 1), options, folder / "net"), core::UsageError);
    CHECK(fs::is_empty(folder.path()));
  };
  refused([](auto& o) { o.steps.reset(); }, scan);
  refused([](auto& o) { o.steps = 0; }, scan);
  refused([](auto& o) { o.minutes = -1; }, scan);
  refused([](auto& o) { o.crop = 0; }, scan);
  refused([](auto& o) { o.candidates = 3; }, scan);
  refused([](auto& o) { o.learning_rate = std::nan(""); }, scan);
  refused([](auto& o) { o.validate_every = 0; }, scan);
  refused([](auto&) {}, shadowed_ball(16, 4));
  refused([](auto&) {}, test::scan_of(std::vector<Direction>(9), {4, 4, 3}, [](auto&, int, int, int) { return 1.0; }));
  CHECK_THROWS_AS(model::train(std::span<const core::OlatScan>(), short_run(5), folder / "net"), core::UsageError);
}

TEST_CASE("a run is resumed with its own settings only") {
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const core::OlatScan scan = shadowed_ball(16, 30);
  model::train(std::span(&scan, 1), short_run(5), folder / "net");
  model::TrainOptions options = short_run(10);
  options.resume = folder / "net";
  options.seed = 2;
  CHECK_THROWS_AS(model::train(std::span(&scan, 1), options, folder / "net"), core::BadInput);
  options.seed = 1;
  CHECK(model::train(std::span(&scan, 1), options, folder / "net").steps == 10);
  options.resume = folder / "nowhere";
  CHECK_THROWS_AS(model::train(std::span(&scan, 1), options, folder / "other"), core::BadInput);
}

TEST_CASE("on real photographs training beats interpolation at lights that were never truth") {
  const fs::path data = test::real_data("loewenkopf240");
  if (data.empty()) SKIP_TEST("the photographs of loewenkopf240 are not there");
  const Quiet quiet;
  const test::TemporaryFolder folder;
  const std::vector<core::LpEntry> entries = core::read_lp(data / "dirs.lp");
  std::vector<core::Light> lights;
  for (const core::LpEntry& entry : entries) lights.push_back({entry.direction, {}, {1, 1, 1}});
  const auto load = [&](std::size_t i) { return core::read_image(data / fs::path(entries[i].name)); };
  const core::OlatScan scan("loewenkopf", lights, load(0).size(), {}, load);

  const OneThread one_thread;
  model::TrainOptions options = short_run(150);
  options.config = model::network_preset("blend");
  options.candidates = 16;
  options.crop = 32;
  options.validate_every = 75;
  const model::TrainReport report = model::train(std::span(&scan, 1), options, folder / "net");
  CHECK(report.curve.back().validation < 0.99 * report.guide_validation);
}

}  // namespace lightstage
