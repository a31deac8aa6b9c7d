// The list of methods, and the options by which commands choose among them.
#include <catch2/catch.hpp>

#include "cli/darkroom.h"
#include "cli/program.h"

using namespace lightstage;
using test::run_program;

TEST_CASE("methods lists every method with its citation and knobs, and every command offers those knobs") {
  const test::TemporaryFolder folder;
  const auto list = run_program(folder / "store", {"methods", "--json"}).json().at("methods");
  REQUIRE(list.size() >= 6);
  CHECK(list[0].at("name") == "nearest");
  CHECK(list[0].at("knobs").empty());
  CHECK(
      list[1].at("knobs")[0] ==
      nlohmann::json(
          {{"option", "--neighbours"}, {"what", "lights that are blended"}, {"default", "8"}, {"values", "1..1000"}}));
  std::vector<std::string> helps;
  for (const std::string command : {"superres", "relight", "evaluate"})
    helps.push_back(run_program(folder / "store", {command, "--help"}).out);
  const std::string text = run_program(folder / "store", {"methods"}).out;
  for (const auto& method : list) {
    const auto of = [](const nlohmann::json& object, const char* key) { return object.at(key).get<std::string>(); };
    const std::string line = of(method, "name") + ": " + of(method, "summary") + " (" + of(method, "citation") + ")";
    CHECK(text.find(of(method, "citation")) != std::string::npos);
    for (const std::string& help : helps) CHECK(help.find(line) != std::string::npos);
    for (const auto& knob : method.at("knobs")) {
      const std::string option = of(knob, "option");
      CAPTURE(option);
      CHECK(text.find(option + (knob.at("values") == "on|off" ? ": " : " " + of(knob, "values") + ": ") +
                      of(knob, "what")) != std::string::npos);
      for (const std::string& help : helps) CHECK(help.find("\n  " + option + " ") != std::string::npos);
    }
  }
}

TEST_CASE("a knob that the method does not have is refused by name, and so is a value that is none") {
  const test::Darkroom darkroom;
  const std::string out = darkroom / "out.exr";
  const auto refused = [&](std::vector<std::string> arguments, const std::vector<std::string>& said) {
    const test::Outcome outcome = darkroom.run(std::move(arguments));
    INFO(outcome.err);
    CHECK(outcome.status == 2);
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    for (const std::string& text : said) CHECK(outcome.err.find(text) != std::string::npos);
  };
  refused({"relight", "ball", "--light", "0,0,1", "--method", "rbf", "--sharpness", "3", "--out", out},
          {"--sharpness", "linear", "not of rbf"});
  refused({"superres", "ball", "--method", "nearest", "--domain", "linear", "--out", "x"}, {"--domain", "nearest"});
  refused({"superres", "ball", "--sharpness", "3", "--out", "x"}, {"--sharpness", "not of blend"});
  refused({"superres", "ball", "--method", "linear", "--bf16", "--out", "x"}, {"--bf16", "superres", "linear"});
  refused({"evaluate", "ball", "--held-out", "--method", "rbf,nearest", "--neighbours", "3"},
          {"--neighbours", "linear", "not of rbf, nearest"});
  refused({"relight", "ball", "--light", "0,0,1", "--method", "rbf", "--domain", "linaer", "--out", out},
          {"--domain: 'linaer'", "did you mean 'linear'?"});
  refused({"relight", "ball", "--light", "0,0,1", "--method", "linear", "--sharpness", "nan", "--out", out},
          {"--sharpness: 'nan'"});
  refused({"relight", "ball", "--light", "0,0,1", "--method", "linear", "--neighbours", "0", "--out", out},
          {"--neighbours: '0'", "1 to 1000"});

  // One of several methods having it is enough; and it reaches that one.
  const auto rmse = [&](const std::string& sharpness) {
    const test::Outcome outcome = darkroom.run({"evaluate", "ball", "--held-out", "--every", "6", "--method",
                                                "nearest,linear,barycentric", "--sharpness", sharpness, "--json"});
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.json().at("methods")[1].at("rmse").get<double>();
  };
  CHECK(rmse("1") != rmse("50"));
}
