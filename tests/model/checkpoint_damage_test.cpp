// Whole checkpoints and training states with one thing wrong: refused with the file and the tensor named, by everything that reads them.
#include <catch2/catch.hpp>
#include <cstring>
#include <limits>

#include "core/error.h"
#include "core/file.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/net/checkpoint_metadata.h"
#include "model/net/safetensors.h"
#include "model/network_interpolator.h"
#include "model/synthetic_scan.h"
#include "model/training.h"
#include "support/support.h"

namespace lightstage {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;
using Catch::Matchers::EndsWith;

core::OlatScan ball() {
  const core::ImageSize size{8, 8, 3};
  return test::scan_of(core::fibonacci_directions(20), size, test::matt_ball(size));
}

model::TrainOptions one_step() {
  model::TrainOptions options;
  options.config = {.neighbours = 3, .channels = {4, 8}, .query_channels = {4}};
  options.candidates = 4;
  options.crop = 8;
  options.steps = 1;
  return options;
}

// A checkpoint as training leaves it, with its state.
std::string trained(const fs::path& path) {
  core::set_quiet(true);
  const core::OlatScan scan = ball();
  model::train(std::span(&scan, 1), one_step(), path);
  core::set_quiet(false);
  return core::read_text_file(path);
}

std::string header_of(const std::string& bytes) {
  std::uint64_t length = 0;
  std::memcpy(&length, bytes.data(), 8);
  return bytes.substr(8, length);
}

// The file with another header, whatever its length.
std::string with_header(const std::string& bytes, const std::string& header) {
  const std::uint64_t length = header.size();
  return std::string(reinterpret_cast<const char*>(&length), 8) + header + bytes.substr(8 + header_of(bytes).size());
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

// "…" of `"name":{…}` in a header.
std::string entry(const std::string& header, const std::string& name) {
  const std::size_t begin = header.find("\"" + name + "\":{");
  REQUIRE(begin != std::string::npos);
  return header.substr(begin, header.find('}', begin) + 1 - begin);
}

template <class Action>
std::string problem(const Action& action) {
  try {
    action();
  } catch (const core::BadInput& error) {
    return error.what();
  }
  return "no error";
}

std::string problem_of_loading(const fs::path& path, const std::string& bytes) {
  core::write_file_atomically(path, bytes);
  return problem([&] { model::make_network_interpolator(ball(), path); });
}

}  // namespace

TEST_CASE("a damaged network is refused when it is loaded, with the tensor named") {
  const test::TemporaryFolder folder;
  const std::string good = trained(folder / "good");
  CHECK(problem([&] { model::make_network_interpolator(ball(), folder / "good"); }) == "no error");
  const std::string header = header_of(good);
  const char* name = "encoder.1.conv.weight";
  const std::string tensor = entry(header, name);
  const auto with_tensor = [&](const std::string& other) {
    return problem_of_loading(folder / "bad", with_header(good, replaced(header, tensor, other)));
  };

  for (const char* dtype : {"F16", "BF16", "I32", "f32", ""}) {
    const std::string text = with_tensor(replaced(tensor, "\"F32\"", "\"" + std::string(dtype) + "\""));
    CHECK_THAT(text, Contains("bad") && Contains(name) && Contains("F32"));
  }
  // As many numbers in another arrangement.
  CHECK_THAT(with_tensor(replaced(tensor, "[8,4,3,3]", "[4,8,3,3]")), Contains(name) && Contains("[8, 4, 3, 3]"));
  CHECK_THAT(with_tensor(replaced(tensor, "[8,4,3,3]", "[8,4,9]")), Contains(name));
  CHECK_THAT(with_tensor(replaced(tensor, "[8,4,3,3]", "[8.0,4,3,3.5]")), Contains(name));
  CHECK_THAT(with_tensor(replaced(tensor, name, "encoder.1.conv.weights")), Contains("missing") && Contains(name));
  CHECK_THAT(with_tensor(tensor + "," + tensor), Contains(name) && Contains("twice"));
  CHECK_THAT(with_tensor(replaced(tensor, name, "encoder.0.conv.weight")), Contains("encoder.0.conv.weight"));
  CHECK_THAT(with_tensor(replaced(tensor, "\"shape\"", "\"form\"")), Contains(name));

  const auto with_config = [&](const std::string& from, const std::string& to) {
    return problem_of_loading(folder / "bad", with_header(good, replaced(header, from, to)));
  };
  CHECK_THAT(with_config(R"("version":"2")", R"("version":"3")"), Contains("version '3'"));
  CHECK_THAT(with_config(R"("version":"2")", R"("other":"2")"), Contains("version ''"));
  CHECK_THAT(with_config("lightstage-network", "lightstage-superres"), Contains("not a checkpoint"));
  CHECK_THAT(with_config(R"(\"channels\":[4,8])", R"(\"channels\":[4,12])"), Contains("encoder.1.conv.weight"));
  CHECK_THAT(with_config(R"(\"channels\":[4,8])", R"(\"channels\":[4,1073741824])"), Contains("channels"));
  for (const char* number : {"1e9", "4294967299", "3.7", "3.0", "true", "-1", "null", "[3]"}) {
    CAPTURE(number);
    CHECK_THAT(with_config(R"(\"neighbours\":3)", R"(\"neighbours\":)" + std::string(number)),
               Contains("neighbours has " + std::string(number).substr(0, 1)));
  }
  CHECK_THAT(with_config(R"(\"channels\":[4,8])", R"(\"channels\":[4,8.5])"), Contains("channels has 8.5"));
  CHECK_THAT(with_config(R"(\"channels\":[4,8])", R"(\"channels\":{\"a\":4,\"b\":8})"), Contains("channels"));
  CHECK_THAT(with_config(R"("version":"2")", R"("version":"2","version":"2")"),
             Contains("'version'") && Contains("twice"));
}

TEST_CASE("numbers that are not finite are refused wherever in a network they stand") {
  const test::TemporaryFolder folder;
  const std::string good = trained(folder / "good");
  const auto stored = model::read_safetensors_header(folder / "good").tensors;
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
    for (const auto& tensor : stored) {
      std::string bytes = good;
      std::memcpy(bytes.data() + tensor.begin + 4 * (tensor.value_count - 1), &bad, 4);
      CHECK_THAT(problem_of_loading(folder / "bad", bytes),
                 Contains("tensor '" + tensor.info.name + "'") && Contains("NaN"));
    }
  }
}

TEST_CASE("texts in the header that are nested deeper than anything that was ever written are refused") {
  const test::TemporaryFolder folder;
  const std::string good = trained(folder / "good");
  const std::string header = header_of(good);
  const std::string provenance = R"("provenance":")";
  const auto with_provenance = [&](const std::string& text) {
    core::write_file_atomically(folder / "bad", with_header(good, replaced(header, provenance, provenance + text)));
    return problem([&] { model::read_checkpoint_info(folder / "bad"); });
  };
  for (const char* bracket : {"[", R"({\"a\":)"}) {
    std::string deep;
    for (int i = 0; i < 200000; ++i) deep += bracket;
    CHECK_THAT(with_provenance(deep), Contains("bad") && Contains("provenance") && Contains("nested"));
  }
  std::string wide;
  for (int i = 0; i < 2000; ++i) wide += "[],";
  CHECK(with_provenance(wide) == "no error");
  // Brackets in a text are no nesting, wherever it seems to end.
  CHECK(with_provenance(R"(\"\\\")" + std::string(2000, '[') + R"(\",)") == "no error");
  CHECK_THAT(with_provenance(R"(\"\\\\\")" + std::string(2000, '[')), Contains("nested"));
}

TEST_CASE("a header that claims more than memory holds is refused before anything is allocated") {
  const test::TemporaryFolder folder;
  const std::string good = trained(folder / "good");
  const std::string header = header_of(good);
  for (const int bits : {34, 40, 50, 62}) {
    const std::uint64_t claimed = std::uint64_t(1) << bits;
    std::string bytes = good;
    std::memcpy(bytes.data(), &claimed, 8);
    CHECK_THAT(problem_of_loading(folder / "bad", bytes), Contains("claims " + std::to_string(claimed)));

    const std::string number = std::to_string(claimed);
    const std::string last = entry(header, "log_sharpness");
    const std::string lie = R"("log_sharpness":{"dtype":"F32","shape":[)" + std::to_string(claimed / 4) +
                            R"(],"data_offsets":[0,)" + number + "]}";
    CHECK_THAT(problem_of_loading(folder / "bad", with_header(good, replaced(header, last, lie))),
               Contains("log_sharpness"));
  }
}

TEST_CASE("a training state that is damaged or of another run is not resumed") {
  const test::TemporaryFolder folder;
  trained(folder / "net");
  const fs::path state_file = folder / "net.state";
  const std::string good = core::read_text_file(state_file);
  const std::string header = header_of(good);
  const core::OlatScan scan = ball();
  const auto resume = [&](const std::string& bytes) {
    core::write_file_atomically(state_file, bytes);
    model::TrainOptions options = one_step();
    options.steps = 2;
    options.resume = folder / "net";
    return problem([&] {
      core::set_quiet(true);
      model::train(std::span(&scan, 1), options, folder / "end");
    });
  };
  const auto with = [&](const std::string& from, const std::string& to) {
    return resume(with_header(good, replaced(header, from, to)));
  };
  CHECK_THAT(resume(good.substr(0, good.size() - 4)), Contains("net.state"));
  CHECK_THAT(resume(good.substr(0, 100)), Contains("net.state"));
  CHECK_THAT(resume(""), Contains("net.state"));
  CHECK_THAT(with("lightstage-training-3", "lightstage-training-2"), Contains("not the state"));
  CHECK_THAT(with(R"(\"step\":1)", R"(\"step\":{})"), Contains("damaged"));
  CHECK_THAT(with(R"(\"adam_steps\")", R"(\"adam_stops\")"), Contains("damaged"));
  CHECK_THAT(with(R"(\"seed\":1)", R"(\"seed\":2)"), Contains("other settings") && EndsWith("these: seed was 2, is 1"));
  CHECK_THAT(with(R"(\"crop\":8,)", R"(\"clip\":8,)"), EndsWith("these: clip was 8, is absent; crop was absent, is 8"));
  CHECK_THAT(with("weight/query.0.bias", "weight/query.0.bios"), Contains("weight/query.0.bias"));
  CHECK_THAT(with("mean/encoder.1.conv.bias", "mien/encoder.1.conv.bias"), Contains("mean/encoder.1.conv.bias"));
  CHECK_FALSE(fs::exists(folder / "end"));
  CHECK(resume(good) == "no error");
  core::set_quiet(false);
}

}  // namespace lightstage
