// What happens to models between commands: kept from being overwritten, chosen, adapted, listed and forgotten.
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <sstream>
#include <thread>

#include "cli/darkroom.h"
#include "cli/program.h"
#include "support/support.h"

using namespace lightstage;
using nlohmann::json;
using test::Darkroom;
using test::show;
namespace fs = std::filesystem;

namespace {

std::string bytes_of(const fs::path& path) {
  std::ostringstream bytes;
  bytes << std::ifstream(path, std::ios::binary).rdbuf();
  return bytes.str();
}

// The model with another text in its header.
void rewrite_header(const fs::path& model, const std::string& from, const std::string& to) {
  constexpr std::size_t kLengthBytes = 8;
  const std::string bytes = bytes_of(model);
  std::uint64_t length = 0;
  std::memcpy(&length, bytes.data(), kLengthBytes);
  std::string header = bytes.substr(kLengthBytes, length);
  const std::size_t at = header.find(from);
  REQUIRE(at != std::string::npos);
  header.replace(at, from.size(), to);
  const std::string numbers = bytes.substr(kLengthBytes + length);
  length = header.size();
  std::ofstream(model, std::ios::binary) << std::string(reinterpret_cast<const char*>(&length), kLengthBytes) << header
                                         << numbers;
}

void check_refused(const test::Outcome& outcome, int status, const std::vector<std::string>& said) {
  INFO(outcome.err);
  CHECK(outcome.status == status);
  CHECK(outcome.out.empty());
  CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
  for (const std::string& text : said) CHECK(outcome.err.find(text) != std::string::npos);
}

bool says(const test::Outcome& outcome, const std::string& text) {
  INFO(outcome.err);
  return outcome.err.find(text) != std::string::npos;
}

const std::vector<std::string> kSmallBlend{"--preset", "blend", "--channels", "4,8", "--steps", "1"};

}  // namespace

TEST_CASE("a run on the name of a finished model is refused and leaves it as it is") {
  const Darkroom darkroom;
  REQUIRE(darkroom.train("good.safetensors", {"--steps", "2"}).status == 0);
  const std::string model = bytes_of(darkroom / "good.safetensors"),
                    state = bytes_of(darkroom / "good.safetensors.state");
  check_refused(darkroom.train("good.safetensors", {"--steps", "2"}), 2, {"good.safetensors", "exists"});
  check_refused(darkroom.train("good.safetensors", {"--steps", "2", "--quiet", "--preset", "paper"}), 2, {"exists"});
  CHECK(bytes_of(darkroom / "good.safetensors") == model);
  CHECK(bytes_of(darkroom / "good.safetensors.state") == state);
  const test::Outcome resumed =
      darkroom.train("good.safetensors", {"--steps", "3", "--resume", darkroom / "good.safetensors"});
  INFO(resumed.err);
  CHECK(resumed.status == 0);
  check_refused(darkroom.train("", {"--steps", "1"}), 2, {"names no file"});
}

TEST_CASE("a model that was no better than rbf is taken only when it is asked for") {
  const Darkroom darkroom;
  const test::Outcome trained = darkroom.train("bad.safetensors", {"--steps", "1"});
  REQUIRE(trained.status == 0);
  REQUIRE(trained.json().at("validation") > trained.json().at("rbf_validation"));
  const auto relight = [&](std::vector<std::string> more) {
    std::vector<std::string> arguments{"relight", "ball", "--light", "0,0,1", "--out", darkroom / "out.exr", "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    test::Outcome outcome = darkroom.run(arguments);
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome;
  };
  const test::Outcome unasked = relight({});
  CHECK(unasked.json().at("method") == "blend");
  CHECK(says(unasked, "bad.safetensors: was no better than rbf"));
  CHECK(std::count(unasked.err.begin(), unasked.err.end(), '\n') == 1);
  for (const auto& asked : {std::vector<std::string>{"--method", "superres"}, {"--model", "bad"}}) {
    const test::Outcome outcome = relight(asked);
    CHECK(outcome.json().at("method") == "superres");
    CHECK_FALSE(says(outcome, "no better"));
  }
}

TEST_CASE("a model file that is no longer the one that was trained is left out") {
  const Darkroom darkroom;
  REQUIRE(darkroom.train("net.safetensors", {"--steps", "1"}).status == 0);
  REQUIRE(darkroom.train("net.safetensors", {"--steps", "2", "--resume", darkroom / "net.safetensors"}).status == 0);
  const auto relight = [&] {
    return darkroom.run({"relight", "ball", "--light", "0,0,1", "--method", "superres", "--out", darkroom / "out.exr"});
  };
  const test::Outcome before = relight();  // entered twice, of which only the second still holds
  INFO(before.err);
  CHECK(before.status == 0);
  CHECK(before.err.empty());
  REQUIRE(darkroom.train("other.safetensors", {"--steps", "1", "--seed", "9", "--hold-out-every", "12"}).status == 0);
  fs::copy_file(darkroom / "other.last.safetensors", darkroom / "net.safetensors",
                fs::copy_options::overwrite_existing);
  std::ofstream(darkroom / "other.safetensors") << "a text";
  const test::Outcome after = relight();
  CHECK(after.status == 2);
  CHECK(says(after, "net.safetensors: is no longer the file"));
  CHECK(says(after, "other.safetensors"));
}

TEST_CASE("what a model's origin says that cannot be understood counts as having seen everything") {
  const Darkroom darkroom;
  std::vector<std::string> options = kSmallBlend;
  options.insert(options.end(), {"--hold-out-every", "6"});
  REQUIRE(darkroom.train("net.safetensors", options).status == 0);
  const std::string held_out = R"(\"held_out_every\":6)", origin = R"(\"start_from\":null)";
  const auto warned = [&](const std::string& from, const std::string& to) {
    fs::copy_file(darkroom / "net.safetensors", darkroom / "changed", fs::copy_options::overwrite_existing);
    rewrite_header(darkroom / "changed", from, to);
    const test::Outcome outcome = darkroom.run(
        {"evaluate", "ball", "--held-out", "--every", "6", "--method", "blend", "--model", darkroom / "changed"});
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return says(outcome, "flattered");
  };
  CHECK_FALSE(warned(held_out, held_out));
  for (const char* other : {R"(\"four\")", "[6]", "{}", "null", "true", "6.5", "0", "-6", "4294967302"}) {
    CAPTURE(other);
    CHECK(warned(held_out, R"(\"held_out_every\":)" + std::string(other)));
  }
  for (const char* other : {R"(\"x\")", "[]", "{}", R"({\"provenance\":7})", "7"}) {
    CAPTURE(other);
    CHECK(warned(origin, R"(\"start_from\":)" + std::string(other)));
  }
  const test::Outcome each =
      darkroom.run({"evaluate", "ball", "--held-out", "--method", "blend", "--model", darkroom / "net.safetensors"});
  REQUIRE(each.status == 0);
  CHECK(says(each, "evaluate with --every N"));
  CHECK_FALSE(says(each, "--hold-out-every 1"));
}

TEST_CASE("removing a scan forgets the models trained on it and leaves their files") {
  const Darkroom darkroom;
  REQUIRE(darkroom.train("net.safetensors", kSmallBlend).status == 0);
  const test::Outcome removed = darkroom.run({"store", "rm", "ball", "--yes", "--json"});
  INFO(removed.err);
  REQUIRE(removed.status == 0);
  CHECK(removed.json().at("removed") == "ball");
  CHECK(removed.json().at("models_left") == json({fs::canonical(darkroom / "net.safetensors").string()}));
  CHECK(fs::exists(darkroom / "net.safetensors"));
  CHECK(darkroom.run({"store", "ls", "--json"}).json().at("scans").empty());
}

TEST_CASE("adapting refuses before it trains, and trains once for each scan that it makes") {
  const Darkroom darkroom;
  const auto superres = [&](const std::string& out, const std::string& minutes) {
    return darkroom.run({"superres", "ball", "--lights", "3", "--adapt", minutes, "--out", out, "--quiet", "--json"});
  };
  const fs::path models = darkroom.store() / "models";
  check_refused(superres("no/name", "60"), 2, {"no/name"});
  check_refused(superres("ball", "60"), 2, {"ball", "exists"});
  REQUIRE(darkroom.run({"superres", "ball", "--lights", "3", "--method", "rbf", "--out", "plain"}).status == 0);
  check_refused(superres("plain", "60"), 2, {"plain", "another way"});
  CHECK_FALSE(fs::exists(models));

  const test::Outcome made = superres("one", "0.01");
  INFO(made.err);
  REQUIRE(made.status == 0);
  CHECK(made.json().at("method") == "blend");
  const std::string one = bytes_of(models / "one.safetensors");
  const test::Outcome again = superres("one", "0.01");
  INFO(again.err);
  REQUIRE(again.status == 0);
  CHECK(again.json().at("already_stored") == 3);
  CHECK(bytes_of(models / "one.safetensors") == one);
  check_refused(superres("one", "0.02"), 2, {"another way"});

  REQUIRE(superres("two", "0.01").status == 0);
  CHECK(bytes_of(models / "one.safetensors") == one);
  // Not from what was adapted before.
  CHECK(show(darkroom, models / "two.safetensors").at("provenance").at("start_from").at("file") == "blend.safetensors");
}

TEST_CASE("adapting that was interrupted goes on by the same command") {
  const Darkroom darkroom;
  const std::vector<std::string> command{"superres", "ball",  "--lights", "2",     "--adapt",
                                         "0.1",      "--out", "dense",    "--json"};
  test::BackgroundRun run(darkroom.store(), command);
  const fs::path model = darkroom.store() / "models" / "dense.safetensors";
  for (int i = 0; i < 6000 && !fs::exists(model); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  REQUIRE(fs::exists(model));
  run.signal(SIGINT);
  REQUIRE(run.wait() == 130);
  // It was training or, on a busy machine, making pictures already.
  const test::Outcome outcome = darkroom.run(command);
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  CHECK(darkroom.run({"store", "ls", "--json"}).json().at("scans").size() == 2);
}

TEST_CASE("meshes that cannot be read are named before training, and folders among them passed over") {
  const test::TemporaryFolder folder;
  fs::create_directories(folder / "meshes/more.ply");
  const auto train = [&] {
    return test::run_program(folder / "store",
                             {"train", "--simulated", "5", "--meshes", (folder / "meshes").string(), "--steps", "1",
                              "--preset", "blend", "--quiet", "--out", (folder / "net.safetensors").string()});
  };
  check_refused(train(), 3, {"meshes", "no meshes"});
  std::ofstream(folder / "meshes/z.ply") << "not a mesh";
  check_refused(train(), 3, {"z.ply"});
  fs::remove(folder / "meshes/z.ply");
  std::ofstream(folder / "meshes/readme.txt") << "heads";
  REQUIRE(mkfifo((folder / "meshes/pipe.ply").c_str(), 0600) == 0);  // never opened: that would wait for ever
  check_refused(train(), 3, {"readme.txt"});
  CHECK_FALSE(fs::exists(folder / "net.safetensors.state"));
}

TEST_CASE("options that would have no effect are refused") {
  const Darkroom darkroom;
  const std::string out = darkroom / "out.safetensors";
  const auto refused = [&](std::vector<std::string> arguments, const std::vector<std::string>& said) {
    check_refused(darkroom.run(std::move(arguments)), 2, said);
  };
  refused({"train", "ball", "--simulated", "5", "--out", out}, {"--simulated", "SCAN"});
  refused({"train", "--simulated", "5", "--hold-out-every", "2", "--out", out}, {"--simulated", "--hold-out-every"});
  refused({"train", "--simulated", "5", "--active-set", "random", "--out", out}, {"--simulated", "--active-set"});
  refused({"train", "ball", "--preset", "tiny", "--start-from", "blend", "--out", out}, {"--preset", "--start-from"});
  refused({"relight", "ball", "--light", "0,0,1", "--method", "rbf", "--model", "no", "--out", darkroom / "a.exr"},
          {"--model", "rbf"});
  refused({"superres", "ball", "--method", "linear", "--model", "blend", "--out", "x"}, {"--model", "linear"});
  refused({"train", "ball", "--channels", "4,,8", "--out", out}, {"--channels", "4,,8"});
  refused({"train", "ball", "--channels", "4,x", "--out", out}, {"--channels", "4,x"});
  refused({"train", "ball", "--seed", "-1", "--out", out}, {"--seed"});
  refused({"train", "ball", "--hold-out-every", "2", "--neighbours", "20", "--steps", "1", "--out", out},
          {"12 lights to learn from"});
  CHECK_FALSE(fs::exists(out));
}

TEST_CASE("a run resumed with other options is told which") {
  const Darkroom darkroom;
  REQUIRE(darkroom.train("net.safetensors", {"--steps", "1"}).status == 0);
  const std::string net = darkroom / "net.safetensors";
  const test::Outcome outcome =
      darkroom.train("net.safetensors", {"--steps", "2", "--seed", "4", "--resume", net, "--quiet"});
  check_refused(outcome, 3, {"net.safetensors.state", "seed was 1, is 4"});
  CHECK(outcome.err.size() < 400);
  check_refused(
      darkroom.train("end.safetensors", {"--steps", "2", "--quiet", "--resume", darkroom / "net.last.safetensors"}), 3,
      {"net.last.safetensors", "told to write"});
}
