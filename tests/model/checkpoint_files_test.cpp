// Checkpoints: what is written is read back, and nothing that is wrong with a file gets past the reader.
#include <catch2/catch.hpp>
#include <cstring>
#include <fstream>
#include <limits>

#include "core/error.h"
#include "core/file.h"
#include "model/checkpoint.h"
#include "model/net/checkpoint_metadata.h"
#include "model/net/safetensors.h"
#include "support/support.h"

namespace lightstage {
namespace {

namespace fs = std::filesystem;
using Catch::Matchers::Contains;

const model::NetworkConfig kConfig{.neighbours = 3, .channels = {4, 8}, .query_channels = {4}, .sharpness = 2.5};

// A checkpoint of zeros with the tensors of kConfig, or of others.
void write(const fs::path& path, const std::vector<model::TensorInfo>& tensors,
           std::map<std::string, std::string> metadata) {
  const std::vector<float> zeros(100000, 0.0f);
  std::vector<model::TensorToStore> stored;
  for (const auto& info : tensors) stored.push_back({info, std::span(zeros).first(model::value_count(info))});
  model::write_safetensors(path, metadata, stored);
}

void write(const fs::path& path) {
  write(path, model::network_tensors(kConfig), model::checkpoint_metadata(kConfig, "{\"seed\":7}"));
}

// A safetensors file of a header as given and so many bytes of numbers.
void write_raw(const fs::path& path, const std::string& header, std::size_t data_bytes) {
  std::string bytes(8, '\0');
  const std::uint64_t length = header.size();
  std::memcpy(bytes.data(), &length, 8);
  core::write_file_atomically(path, bytes + header + std::string(data_bytes, '\0'));
}

std::string problem(const fs::path& path) {
  try {
    model::read_checkpoint_info(path);
  } catch (const core::BadInput& error) {
    CHECK_THAT(error.what(), Contains(path.filename().string()));
    CHECK(std::string(error.what()).find('\n') == std::string::npos);
    return error.what();
  }
  return "no error";
}

}  // namespace

TEST_CASE("a checkpoint's header says what was written") {
  const test::TemporaryFolder folder;
  write(folder / "a.safetensors");
  const model::CheckpointInfo info = model::read_checkpoint_info(folder / "a.safetensors");
  CHECK(info.config == kConfig);
  CHECK(info.provenance == "{\"seed\":7}");
  CHECK(info.tensors == model::network_tensors(kConfig));
  std::size_t parameters = 0;
  for (const auto& tensor : info.tensors) parameters += model::value_count(tensor);
  CHECK(info.parameters == parameters);
}

TEST_CASE("tensors come back as they were, in any order and shape") {
  const test::TemporaryFolder folder;
  const std::vector<float> a{1.5f, -0.0f, 65504.0f, std::numeric_limits<float>::denorm_min(), 3, 4}, scalar{2};
  const std::vector<model::TensorToStore> stored{
      {{"z.first", {2, 3}}, a}, {{"a.second", {}}, scalar}, {{"none", {0, 5}}, {}}};
  model::write_safetensors(folder / "t", {{"key", "a \"text\"\nin two lines"}}, stored);
  const model::SafetensorsHeader header = model::read_safetensors_header(folder / "t");
  CHECK(header.metadata.at("key") == "a \"text\"\nin two lines");
  REQUIRE(header.tensors.size() == 3);
  CHECK(header.tensors[0].info.name == "z.first");
  for (const auto& tensor : header.tensors) {
    const std::vector<float> values = model::read_tensor(folder / "t", tensor);
    if (tensor.info.name == "z.first") CHECK(std::memcmp(values.data(), a.data(), sizeof(float) * a.size()) == 0);
    if (tensor.info.name == "a.second") CHECK(values == scalar);
    if (tensor.info.name == "none") CHECK(values.empty());
  }
}

TEST_CASE("presets are valid, and others are refused") {
  for (const char* name : {"tiny", "small", "paper", "blend", "xu", "xu_adaptive", "meka"})
    CHECK(!model::network_tensors(model::network_preset(name)).empty());
  CHECK_THROWS_AS(model::network_preset("huge"), core::UsageError);
  const auto with = [](const auto& change) {
    model::NetworkConfig config = kConfig;
    change(config);
    return config;
  };
  CHECK_THROWS_AS(model::network_tensors(with([](auto& c) { c.query_channels = {}; })), core::BadInput);
  CHECK_THROWS_AS(model::network_tensors(with([](auto& c) { c.architecture = model::Architecture::kBlend; })),
                  core::BadInput);
  for (const auto architecture : {model::Architecture::kXu, model::Architecture::kXuAdaptive}) {
    CHECK_NOTHROW(model::network_tensors(with([&](auto& c) { c.architecture = architecture; })));
    CHECK_THROWS_WITH(model::network_tensors(with([&](auto& c) {
                        c.architecture = architecture;
                        c.query_channels = {};
                      })),
                      Contains("needs 1 to 8 query_channels"));
    CHECK_THROWS_WITH(model::network_tensors(with([&](auto& c) {
                        c.architecture = architecture;
                        c.pooling = model::Pooling::kAverage;
                      })),
                      Contains("alias_free"));
  }
  const auto meka = [&](int neighbours, std::vector<int> query_channels) {
    return with([&](auto& c) {
      c.architecture = model::Architecture::kMeka;
      c.neighbours = neighbours;
      c.query_channels = query_channels;
    });
  };
  CHECK_NOTHROW(model::network_tensors(meka(2, {})));
  CHECK_THROWS_WITH(model::network_tensors(meka(8, {})), Contains("neighbours must be 2"));
  CHECK_THROWS_WITH(model::network_tensors(meka(2, {4})), Contains("meka has no query_channels"));
  CHECK_THROWS_AS(model::network_tensors(with([](auto& c) { c.neighbours = 0; })), core::BadInput);
  CHECK_THROWS_AS(model::network_tensors(with([](auto& c) { c.channels = {}; })), core::BadInput);
  CHECK_THROWS_AS(model::network_tensors(with([](auto& c) { c.channels = {6}; })), core::BadInput);
  CHECK_THROWS_AS(model::network_tensors(with([](auto& c) { c.channels = {1 << 30}; })), core::BadInput);
  CHECK_THROWS_AS(model::network_tensors(with([](auto& c) { c.sharpness = 0; })), core::BadInput);
}

TEST_CASE("a network's operations are those counted by hand") {
  using model::Architecture;
  // superres, k = 3: encoders 6 -> 4 at 1/4 and 4 -> 8 at 1/16 of the pixels, for each image; decoders (4 + 8) -> 4 from 1/16, (4 + 4) -> 4 from
  // 1/4; 4 -> 3 at full size. Nine taps, two operations.
  const double superres = 18 * (3 * (24 / 4.0 + 32 / 16.0) + 48 / 16.0 + 32 / 4.0 + 12);
  CHECK(model::flop_per_pixel(kConfig) == Approx(superres));
  // 24 of xu's channels come from 4 images and their lights: 24 -> 4, 4 -> 8 at 1/4; (8 + 4) -> 4 from 1/4; 8 -> 4, 4 -> 3.
  model::NetworkConfig config{
      .architecture = Architecture::kXu, .neighbours = 4, .channels = {4, 8}, .query_channels = {4}};
  CHECK(model::flop_per_pixel(config) == Approx(18 * (96 + 32 / 4.0 + 48 / 4.0 + 32 + 12)));
  config.architecture = Architecture::kXuAdaptive;  // 6 -> 4 four times
  CHECK(model::flop_per_pixel(config) == Approx(18 * (96 + 32 / 4.0 + 48 / 4.0 + 32 + 12)));
  config = {.architecture = Architecture::kMeka, .neighbours = 2, .channels = {4, 8}};
  CHECK(model::flop_per_pixel(config) == Approx(18 * (36 + 32 / 4.0 + 32 / 4.0 + 32 + 12)));
  // blend, k = 2: as its drawing in docs/model.md says.
  config = {.architecture = Architecture::kBlend, .neighbours = 2, .channels = {4, 8}};
  const double ones = 2 * (2 * 16 * 7 + 16 * 8 + 2 * 16);  // of the head
  CHECK(model::flop_per_pixel(config) ==
        Approx(18 * (2 * (24 + 32 / 4.0) + 16 * 16 / 4.0 + 12 + 16 * 8 + 3 * 8) + ones));
}

TEST_CASE("a checkpoint cut short anywhere is refused") {
  const test::TemporaryFolder folder;
  write(folder / "whole");
  const std::string bytes = core::read_text_file(folder / "whole");
  for (std::size_t length :
       {std::size_t(0), std::size_t(7), std::size_t(8), std::size_t(100), bytes.size() / 2, bytes.size() - 1}) {
    core::write_file_atomically(folder / "cut", bytes.substr(0, length));
    CHECK(problem(folder / "cut") != "no error");
  }
  core::write_file_atomically(folder / "long", bytes + "x");
  CHECK_THAT(problem(folder / "long"), Contains("bytes"));
  CHECK_THAT(problem(folder / "missing"), Contains("no such"));
  CHECK(problem(folder.path()) != "no error");
}

TEST_CASE("a checkpoint with any byte of its header damaged is refused or reads as valid, and never crashes") {
  const test::TemporaryFolder folder;
  write(folder / "whole");
  const std::string bytes = core::read_text_file(folder / "whole");
  std::uint64_t header_length = 0;
  std::memcpy(&header_length, bytes.data(), 8);
  std::size_t refused = 0, tried = 0;
  for (std::size_t at = 0; at < 8 + header_length; at += 3, ++tried) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x15);
    std::ofstream(folder / "damaged", std::ios::binary) << damaged;
    try {
      model::read_checkpoint_info(folder / "damaged");
    } catch (const core::BadInput&) {
      ++refused;
    }
  }
  CHECK(refused > tried * 9 / 10);  // the rest are digits of provenance or padding
}

TEST_CASE("headers that lie are refused with the tensor named") {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "lie";
  const auto claim = [&](const std::string& tensor, std::size_t data_bytes) {
    write_raw(path, "{\"a.tensor\":" + tensor + "}", data_bytes);
    return problem(path);
  };
  CHECK_THAT(claim(R"({"dtype":"F32","shape":[2],"data_offsets":[0,9]})", 8), Contains("a.tensor"));
  CHECK_THAT(claim(R"({"dtype":"F32","shape":[3],"data_offsets":[0,8]})", 8), Contains("a.tensor"));
  CHECK_THAT(claim(R"({"dtype":"F32","shape":[2],"data_offsets":[8,0]})", 8), Contains("a.tensor"));
  CHECK_THAT(claim(R"({"dtype":"F32","shape":[-2],"data_offsets":[0,8]})", 8), Contains("a.tensor"));
  CHECK_THAT(claim(R"({"dtype":"F64","shape":[1],"data_offsets":[0,8]})", 8), Contains("F32"));
  CHECK_THAT(claim(R"({"dtype":"F32","shape":[1],"data_offsets":[4,8]})", 8), Contains("gap"));
  CHECK_THAT(claim(R"({"shape":[2]})", 8), Contains("a.tensor"));
  CHECK_THAT(claim("17", 8), Contains("a.tensor"));
  // 2^62 values would need more bytes than a size can count.
  CHECK_THAT(claim(R"({"dtype":"F32","shape":[2147483648,2147483648],"data_offsets":[0,0]})", 0), Contains("a.tensor"));
  write_raw(path, "[1,2]", 0);
  CHECK_THAT(problem(path), Contains("JSON"));
  write_raw(path, "{\"__metadata__\":{\"a\":1}}", 0);
  CHECK_THAT(problem(path), Contains("__metadata__"));
  const std::uint64_t huge = std::numeric_limits<std::uint64_t>::max();
  core::write_file_atomically(path, std::string(reinterpret_cast<const char*>(&huge), 8) + "{}");
  CHECK_THAT(problem(path), Contains("claims"));
}

TEST_CASE("checkpoints of other programs, versions and shapes are refused") {
  const test::TemporaryFolder folder;
  const auto tensors = model::network_tensors(kConfig);
  const auto metadata = model::checkpoint_metadata(kConfig, "");
  const auto with = [&](const std::string& key, const std::string& value) {
    auto changed = metadata;
    changed[key] = value;
    write(folder / "c", tensors, changed);
    return problem(folder / "c");
  };
  const auto config = [](const std::string& channels, const std::string& sharpness, const std::string& pooling) {
    return R"({"architecture":"superres","neighbours":3,"query_channels":[4],"channels":)" + channels +
           ",\"sharpness\":" + sharpness + ",\"pooling\":\"" + pooling + "\"}";
  };
  CHECK_THAT(with("config", config("[4,8]", "1", "median")), Contains("pooling is 'median'"));
  CHECK_THAT(with("config", R"({"architecture":"yu"})"), Contains("'yu', must be superres or blend or xu or"));
  CHECK_THAT(with("format", "pt"), Contains("not a checkpoint of this program"));
  CHECK_THAT(with("version", "1"), Contains("version '1'"));
  CHECK_THAT(with("config", "{"), Contains("configuration"));
  CHECK_THAT(with("config", config("[4,8]", "-1", "alias_free")), Contains("sharpness"));
  CHECK_THAT(with("config", config("[4,16]", "1", "alias_free")), Contains("encoder.1.conv.weight"));

  auto fewer = tensors;
  fewer.erase(fewer.begin() + 2);
  write(folder / "c", fewer, metadata);
  CHECK_THAT(problem(folder / "c"), Contains("'" + tensors[2].name + "' is missing"));
  auto more = tensors;
  more.push_back({"extra", {1}});
  write(folder / "c", more, metadata);
  CHECK_THAT(problem(folder / "c"), Contains("no part of the network"));
}

TEST_CASE("numbers that are not finite are refused with the tensor named") {
  const test::TemporaryFolder folder;
  const std::vector<float> values{1, std::numeric_limits<float>::quiet_NaN()};
  const std::vector<model::TensorToStore> stored{{{"bad", {2}}, values}};
  model::write_safetensors(folder / "n", {}, stored);
  const auto header = model::read_safetensors_header(folder / "n");
  CHECK_THROWS_WITH(model::read_tensor(folder / "n", header.tensors[0]), Contains("bad"));
}

}  // namespace lightstage
