// What a training run finds on disk: models that it must not destroy, states and checkpoints that it goes on from.
#include <catch2/catch.hpp>
#include <cstring>

#include "core/error.h"
#include "core/file.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/net/safetensors.h"
#include "model/synthetic_scan.h"
#include "model/training.h"
#include "support/support.h"

namespace lightstage {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;

core::OlatScan ball(double brightness = 1) {
  const core::ImageSize size{12, 12, 3};
  const test::PixelFunction matt = test::matt_ball(size);
  return test::scan_of(core::fibonacci_directions(24), size, [=](const core::Direction& light, int y, int x, int c) {
    return brightness * matt(light, y, x, c) + (y == 3 ? 0.05 : 0.0);
  });
}

model::TrainOptions short_run(std::int64_t steps) {
  model::TrainOptions options;
  options.config = {
      .architecture = model::Architecture::kBlend, .neighbours = 4, .channels = {4, 8}, .query_channels = {}};
  options.crop = 12;
  options.candidates = 8;
  options.steps = steps;
  options.validate_every = 5;
  return options;
}

struct Fixture {
  Fixture() { core::set_quiet(true); }
  ~Fixture() { core::set_quiet(false); }

  model::TrainReport train(const model::TrainOptions& options, const fs::path& out,
                           const core::OlatScan& scan = ball()) const {
    return model::train(std::span(&scan, 1), options, out);
  }

  template <class Expected>
  std::string refusal(const model::TrainOptions& options, const fs::path& out,
                      const core::OlatScan& scan = ball()) const {
    const auto before = files();
    std::string message = "no error";
    try {
      train(options, out, scan);
    } catch (const Expected& error) {
      message = error.what();
    }
    CHECK((files() == before));
    return message;
  }

  // Every file with its bytes.
  std::map<std::string, std::string> files() const {
    std::map<std::string, std::string> all;
    for (const auto& entry : fs::directory_iterator(folder.path())) {
      if (entry.is_regular_file()) all[entry.path().filename()] = core::read_text_file(entry.path());
    }
    return all;
  }

  test::TemporaryFolder folder;
};

}  // namespace

TEST_CASE_METHOD(Fixture, "a run never replaces a model that it does not resume") {
  train(short_run(10), folder / "good.safetensors");
  train(short_run(5), folder / "other.safetensors");
  const fs::path good = folder / "good.safetensors";
  CHECK_THAT(refusal<core::UsageError>(short_run(5), good), Contains(good.string()) && Contains("exists"));
  // Nor one whose name it would give to its last weights.
  CHECK_THAT(refusal<core::UsageError>(short_run(5), folder / "other"), Contains("other.last.safetensors"));

  CHECK_THAT(refusal<core::UsageError>(short_run(5), folder.path() / ""), Contains("names no file"));

  model::TrainOptions options = short_run(15);
  options.resume = folder / "other.safetensors";
  CHECK_THAT(refusal<core::UsageError>(options, good), Contains("exists"));
  options.resume = folder.path() / "." / "good.safetensors";
  CHECK(train(options, good).steps == 15);
  CHECK(train(options, folder / "third.safetensors").steps == 15);
}

TEST_CASE_METHOD(Fixture, "a run is resumed on the pictures that it learned from only") {
  train(short_run(5), folder / "net.safetensors");
  model::TrainOptions options = short_run(10);
  options.resume = folder / "net.safetensors";
  CHECK_THAT(refusal<core::BadInput>(options, folder / "net.safetensors", ball(0.5)), Contains("exposure was"));
  CHECK(train(options, folder / "net.safetensors").steps == 10);
}

TEST_CASE_METHOD(Fixture, "a run whose best weights are gone or damaged is not resumed") {
  const fs::path net = folder / "net.safetensors";
  train(short_run(5), net);
  model::TrainOptions options = short_run(10);
  options.resume = net;
  const std::string good = core::read_text_file(net);
  for (const fs::path& out : {net, folder / "new.safetensors"}) {
    fs::remove(net);
    CHECK_THAT(refusal<core::BadInput>(options, out), Contains(net.string()));
    core::write_file_atomically(net, "a text");
    CHECK_THAT(refusal<core::BadInput>(options, out), Contains(net.string()) && Contains("not a safetensors file"));
    core::write_file_atomically(net, good.substr(0, good.size() - 1));
    CHECK_THAT(refusal<core::BadInput>(options, out), Contains(net.string()));
  }
  model::TrainOptions larger = short_run(1);
  larger.config.channels = {4, 12};
  train(larger, folder / "larger");
  core::write_file_atomically(net, core::read_text_file(folder / "larger"));
  CHECK_THAT(refusal<core::BadInput>(options, net), Contains(net.string()) && Contains("not the network"));
  core::write_file_atomically(net, good);
  CHECK(train(options, net).steps == 10);

  options.resume = folder / "net.last.safetensors";
  CHECK_THAT(refusal<core::BadInput>(options, folder / "end"),
             Contains("net.last.safetensors.state") && Contains("resumed from the file it was told to write"));
}

TEST_CASE_METHOD(Fixture, "a run that fails in the middle leaves a state to go on from, with the same result") {
  model::SimulatedViews views;
  views.count = 12;
  views.description = R"({"views":12})";
  bool damaged = true;
  views.make = [&](std::size_t index) {
    if (damaged && index >= 8) throw core::BadInput("view 8 cannot be made");
    model::TruthView view{ball(), core::random_directions(6, index), {}};
    for (const core::Direction& query : view.queries) {
      view.truth.push_back(test::picture_of({12, 12, 3}, query, test::matt_ball({12, 12, 3})));
    }
    return view;
  };
  model::TrainOptions options = short_run(90);
  options.validate_every = 1000;  // nothing but the failure has it saved
  CHECK_THROWS_WITH(model::train(views, options, folder / "net"), "view 8 cannot be made");
  damaged = false;
  options.resume = folder / "net";
  const model::TrainReport resumed = model::train(views, options, folder / "net");
  CHECK(resumed.steps == 90);
  const std::string state = model::read_safetensors_header(folder / "net.state").metadata.at("state");
  CHECK_THAT(state, Contains(R"("step":90)"));
  options.resume.reset();
  const model::TrainReport whole = model::train(views, options, folder / "whole");
  CHECK(resumed.curve.back().train == Approx(whole.curve.back().train).epsilon(1e-3));
}

TEST_CASE_METHOD(Fixture, "a network whose pictures are not finite is no start") {
  train(short_run(1), folder / "net");
  std::string bytes = core::read_text_file(folder / "net");
  for (const auto& tensor : model::read_safetensors_header(folder / "net").tensors) {
    const float huge = 3e38f;
    for (std::size_t i = 0; i < tensor.value_count; ++i) std::memcpy(bytes.data() + tensor.begin + 4 * i, &huge, 4);
  }
  core::write_file_atomically(folder / "huge", bytes);
  model::TrainOptions options = short_run(5);
  options.start_from = folder / "huge";
  CHECK_THAT(refusal<core::BadInput>(options, folder / "out"),
             Contains((folder / "huge").string()) && Contains("finite"));
}

}  // namespace lightstage
