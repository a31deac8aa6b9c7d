// Training as a user asks for it: ablations, files left behind, and what a model file tells about itself.
#include <catch2/catch.hpp>
#include <fstream>
#include <set>

#include "cli/darkroom.h"
#include "cli/program.h"
#include "support/support.h"

using namespace lightstage;
using nlohmann::json;
using test::Darkroom;
using test::show;
namespace fs = std::filesystem;

TEST_CASE("a model tells its configuration, its tensors and where it comes from") {
  const Darkroom darkroom;
  const test::Outcome trained = darkroom.train("net.safetensors", {"--steps", "3", "--seed", "5"});
  INFO(trained.err);
  REQUIRE(trained.status == 0);
  CHECK(trained.json().at("last") == darkroom / "net.last.safetensors");
  for (const char* left : {"net.safetensors.csv", "net.safetensors.png", "net.safetensors.state"}) {
    CHECK(fs::file_size(darkroom / left) > 0);
  }

  for (const char* file : {"net.safetensors", "net.last.safetensors"}) {
    const json model = show(darkroom, darkroom / file);
    CHECK(model.at("configuration").at("architecture") == "superres");
    CHECK(model.at("configuration").at("channels").size() == 4);
    CHECK(model.at("provenance").at("seed") == 5);
    CHECK(model.at("provenance").at("progressive") == false);
    CHECK(model.at("provenance").at("active_set") == "random");
    CHECK(model.at("provenance").at("data").at(0).at("name") == "ball");
    std::int64_t parameters = 0;
    for (const json& tensor : model.at("tensors")) {
      std::int64_t count = 1;
      for (const json& dimension : tensor.at("shape")) count *= dimension.get<std::int64_t>();
      parameters += count;
    }
    CHECK(model.at("parameters") == parameters);
    CHECK(model.at("tensors").at(0).at("name") == "encoder.0.conv.weight");
    CHECK(model.at("tensors").at(0).at("shape") == json({16, 6, 3, 3}));
  }

  CHECK(show(darkroom, "blend").at("configuration").at("architecture") == "blend");

  const std::string text = darkroom.run({"model", "show", darkroom / "net.safetensors"}).out;
  for (const char* said : {"encoder.0.conv.weight", "16 x 6 x 3 x 3", "log_sharpness", "scalar", "seed: 5"}) {
    CHECK(text.find(said) != std::string::npos);
  }
}

TEST_CASE("ablations are options, and what was asked for is on record") {
  const Darkroom darkroom;
  const test::Outcome trained =
      darkroom.train("net.safetensors", {"--steps", "2", "--active-set", "naive", "--pooling", "average",
                                         "--progressive", "off", "--freeze-sharpness", "--early-stop", "3"});
  INFO(trained.err);
  REQUIRE(trained.status == 0);
  CHECK(trained.json().at("stopped_early") == false);
  const json model = show(darkroom, darkroom / "net.safetensors");
  CHECK(model.at("configuration").at("pooling") == "average");
  CHECK(model.at("provenance").at("active_set") == "naive");
  CHECK(model.at("provenance").at("progressive") == false);
  CHECK(model.at("provenance").at("sharpness_rate") == 0);

  const auto refused = [&](std::vector<std::string> options, const std::string& said) {
    const test::Outcome outcome = darkroom.train("other.safetensors", std::move(options));
    INFO(outcome.err);
    CHECK(outcome.status == 2);
    CHECK(outcome.err.find(said) != std::string::npos);
    CHECK_FALSE(fs::exists(darkroom / "other.safetensors"));
  };
  refused({"--active-set", "best"}, "best");
  refused({"--preset", "blend", "--pooling", "average"}, "alias_free");
  refused({"--preset", "blend", "--progressive", "on"}, "blend");
  refused({"--preset", "blend", "--channels", "16,5"}, "multiple of 4");
  refused({"--start-from", "blend", "--neighbours", "4"}, "--neighbours");
  refused({"--freeze-sharpness", "--sharpness-rate", "1"}, "--sharpness-rate");
}

TEST_CASE("the sizes of a preset can be changed one by one") {
  const Darkroom darkroom;
  const test::Outcome trained = darkroom.train(
      "net.safetensors", {"--preset", "blend", "--channels", "4,12", "--neighbours", "3", "--steps", "1"});
  INFO(trained.err);
  REQUIRE(trained.status == 0);
  const json configuration = show(darkroom, darkroom / "net.safetensors").at("configuration");
  CHECK(configuration.at("channels") == json({4, 12}));
  CHECK(configuration.at("neighbours") == 3);
  CHECK(darkroom.train("many.safetensors", {"--neighbours", "20", "--steps", "1"}).status == 0);
}

TEST_CASE("other publications' networks are trained by name and judged side by side") {
  const Darkroom darkroom;
  for (const std::string preset : {"xu", "xu_adaptive", "meka"}) {
    const test::Outcome trained = darkroom.train(
        preset + ".safetensors", {"--preset", preset, "--channels", "4,8", "--steps", "2", "--hold-out-every", "6"});
    INFO(trained.err);
    REQUIRE(trained.status == 0);
    const json model = show(darkroom, darkroom / (preset + ".safetensors"));
    CHECK(model.at("configuration").at("architecture") == preset);
    CHECK(model.at("flop_per_pixel").get<double>() > 1000);
    const std::set<json> looked_at = model.at("looks_at");
    CHECK(looked_at.size() == (preset == "xu" ? 8 : 0));  // all different
    for (const json& place : looked_at) {
      double squares = 0;
      for (const double coordinate : place) squares += coordinate * coordinate;
      CHECK(squares == Approx(1));
    }
  }
  const auto evaluate = [&](const std::string& methods, const std::string& models) {
    return darkroom.run({"evaluate", "ball", "--held-out", "--every", "6", "--method", methods, "--model", models,
                         "--threads", "1", "--json"});
  };
  const auto files = [&](const std::vector<std::string>& names) {
    std::string text;
    for (const std::string& name : names) text += (text.empty() ? "" : ",") + (darkroom / (name + ".safetensors"));
    return text;
  };
  const test::Outcome judged = evaluate("nearest,meka,xu_adaptive,xu", files({"xu", "xu_adaptive", "meka"}));
  INFO(judged.err);
  REQUIRE(judged.status == 0);
  std::vector<std::string> names;
  const json scores = judged.json();
  for (const auto& method : scores.at("methods")) names.push_back(method.at("name"));
  CHECK(names == std::vector<std::string>{"nearest", "meka", "xu_adaptive", "xu"});

  const auto refused = [&](const std::string& methods, const std::string& models, const std::string& said) {
    const test::Outcome outcome = evaluate(methods, models);
    INFO(outcome.err);
    CHECK(outcome.status == 2);
    CHECK(outcome.err.find(said) != std::string::npos);
  };
  refused("xu", files({"meka"}), "is a model for --method meka, which is not among the methods");
  refused("xu,meka", files({"xu", "xu"}), "both for method xu");
  CHECK(darkroom.train("no.safetensors", {"--preset", "meka", "--neighbours", "4"}).status == 2);
  CHECK(darkroom.train("no.safetensors", {"--preset", "xu", "--active-set", "naive", "--progressive", "on"}).status ==
        2);
  const test::Outcome relit = darkroom.run({"superres", "ball", "--lights", "30", "--method", "xu", "--model",
                                            darkroom / "meka.safetensors", "--out", "dense"});
  CHECK(relit.status == 2);
  CHECK(relit.err.find("is a model for --method meka") != std::string::npos);
}

TEST_CASE("whoever is judged on lights that it was trained on, or its origin was, is warned") {
  const Darkroom darkroom;
  const auto train_one = [&](const std::string& out, std::vector<std::string> more) {
    more.insert(more.end(), {"--steps", "1"});
    REQUIRE(darkroom.train(out, std::move(more)).status == 0);
  };
  train_one("all.safetensors", {"--preset", "blend", "--channels", "4,8"});
  train_one("most.safetensors", {"--preset", "blend", "--channels", "4,8", "--hold-out-every", "6"});
  train_one("all_then_most.safetensors", {"--start-from", darkroom / "all.safetensors", "--hold-out-every", "6"});
  const auto warned = [&](const std::string& file, const std::string& every) {
    const test::Outcome outcome =
        darkroom.run({"evaluate", "ball", "--held-out", "--every", every, "--method", "blend", "--model", file});
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.err.find("flattered") != std::string::npos;
  };
  CHECK(warned(darkroom / "all.safetensors", "6"));
  CHECK_FALSE(warned(darkroom / "most.safetensors", "6"));
  CHECK_FALSE(warned(darkroom / "most.safetensors", "12"));
  CHECK(warned(darkroom / "most.safetensors", "8"));
  CHECK(warned(darkroom / "all_then_most.safetensors", "6"));
  CHECK_FALSE(warned("blend", "6"));
}

TEST_CASE("a name that stands for no model is refused; the shipped model's needs no store") {
  const test::TemporaryFolder folder;
  const auto train_from = [&](const std::string& name) {
    return test::run_program(folder / "nowhere",
                             {"train", "--start-from", name, "--out", (folder / "x.safetensors").string()});
  };
  CHECK(train_from("blend").status == 2);  // no data to learn from: the model was found
  CHECK(train_from("blendx").status == 5);
}

TEST_CASE("what is no model is not shown") {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "text.safetensors") << "not a model";
  for (const char* file : {"text.safetensors", "none.safetensors"}) {
    const test::Outcome outcome = test::run_program(folder / "store", {"model", "show", (folder / file).string()});
    CHECK(outcome.status == 3);
    CHECK(outcome.out.empty());
    CHECK(outcome.err.find(file) != std::string::npos);
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
  }
}
