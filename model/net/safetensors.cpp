#include "model/net/safetensors.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <system_error>

#include "core/error.h"
#include "core/file.h"
#include "core/nesting.h"

namespace lightstage::model {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

static_assert(std::endian::native == std::endian::little, "safetensors numbers are little-endian");

constexpr std::uint64_t kMaxHeaderBytes = 16 << 20;
constexpr std::size_t kLengthBytes = 8;
constexpr const char* kMetadataKey = "__metadata__";

core::BadInput bad_file(const fs::path& path, const std::string& problem) {
  return core::BadInput(path.string() + ": " + problem);
}

std::ifstream open(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || !fs::is_regular_file(path))
    throw bad_file(path, "there is no such checkpoint file, or it cannot be read");
  return file;
}

std::string read_header_text(const fs::path& path, std::uint64_t file_bytes) {
  std::ifstream file = open(path);
  std::uint64_t length = 0;
  if (file_bytes < kLengthBytes || !file.read(reinterpret_cast<char*>(&length), kLengthBytes)) {
    throw bad_file(path, "is not a safetensors file: it is shorter than 8 bytes");
  }
  if (length > kMaxHeaderBytes || length > file_bytes - kLengthBytes) {
    throw bad_file(path, "is not a safetensors file, or is truncated: its header claims " + std::to_string(length) +
                             " bytes, the file has " + std::to_string(file_bytes));
  }
  std::string text(length, '\0');
  if (!file.read(text.data(), static_cast<std::streamsize>(length))) throw bad_file(path, "its header cannot be read");
  return text;
}

// 4 * product of the dimensions, where that is no more than `limit`.
std::optional<std::uint64_t> byte_count(const std::vector<std::int64_t>& shape, std::uint64_t limit) {
  std::uint64_t bytes = sizeof(float);
  for (const std::int64_t dimension : shape) {
    if (dimension < 0) return std::nullopt;
    if (dimension != 0 && bytes > limit / std::uint64_t(dimension)) return std::nullopt;
    bytes *= std::uint64_t(dimension);
  }
  return bytes;
}

// Others would be rounded or wrap around without a word.
bool whole_numbers(const Json& list) {
  return std::all_of(list.begin(), list.end(), [](const Json& number) { return number.is_number_unsigned(); });
}

StoredTensor parse_tensor(const fs::path& path, const std::string& name, const Json& entry, std::uint64_t data_bytes) {
  const auto fail = [&](const std::string& problem) { return bad_file(path, "tensor '" + name + "' " + problem); };
  try {
    if (entry.at("dtype").get<std::string>() != "F32") throw fail("is not of type F32");
    if (!whole_numbers(entry.at("shape")) || !whole_numbers(entry.at("data_offsets"))) {
      throw fail("has a shape or offsets that are not whole numbers");
    }
    StoredTensor tensor{{name, entry.at("shape").get<std::vector<std::int64_t>>()}};
    const auto offsets = entry.at("data_offsets").get<std::vector<std::uint64_t>>();
    if (offsets.size() != 2 || offsets[0] > offsets[1] || offsets[1] > data_bytes) {
      throw fail("has offsets outside the file: the file is truncated or damaged");
    }
    if (byte_count(tensor.info.shape, data_bytes) != offsets[1] - offsets[0]) {
      throw fail("has a shape that does not fit its offsets");
    }
    tensor.begin = offsets[0];
    tensor.value_count = (offsets[1] - offsets[0]) / sizeof(float);
    return tensor;
  } catch (const Json::exception&) {
    throw fail("is not described by dtype, shape and data_offsets");
  }
}

// Texts in the header are mostly JSON, and what walks through JSON goes one call deeper for each level.
void refuse_deep_nesting(const fs::path& path, const std::map<std::string, std::string>& metadata) {
  for (const auto& [key, text] : metadata) {
    if (core::json_nests_deeper(text, core::kMostJsonLevels)) {
      throw bad_file(path,
                     "its " + key + " is nested more than " + std::to_string(core::kMostJsonLevels) + " levels deep");
    }
  }
}

// The parser keeps the last of several entries of one name, and the file would mean something else to another reader.
Json parse_header(const fs::path& path, const std::string& text) {
  std::vector<std::set<std::string>> names(3);  // by depth: tensors and __metadata__, and the keys of each
  const auto refuse_duplicates = [&](int depth, Json::parse_event_t event, Json& parsed) {
    if (event != Json::parse_event_t::key || depth > 2) return true;
    const auto name = parsed.get<std::string>();
    if (depth == 1) names[2].clear();
    if (!names[std::size_t(depth)].insert(name).second) {
      throw bad_file(path, (depth == 1 ? "tensor '" : "'") + name + "' stands in the header twice");
    }
    return true;
  };
  Json json = Json::parse(text, refuse_duplicates, /*allow_exceptions=*/false);
  if (!json.is_object()) throw bad_file(path, "is not a safetensors file: its header is not a JSON object");
  return json;
}

}  // namespace

std::size_t value_count(const TensorInfo& info) {
  std::size_t count = 1;
  for (const std::int64_t dimension : info.shape) count *= std::size_t(dimension);
  return count;
}

SafetensorsHeader read_safetensors_header(const fs::path& path) {
  std::error_code error;
  const std::uintmax_t file_bytes = fs::file_size(path, error);
  if (error) throw bad_file(path, "there is no such checkpoint file, or it cannot be read");
  const std::string text = read_header_text(path, file_bytes);
  const std::uint64_t data_begin = kLengthBytes + text.size();
  const std::uint64_t data_bytes = file_bytes - data_begin;

  const Json json = parse_header(path, text);

  SafetensorsHeader header;
  for (const auto& [name, entry] : json.items()) {
    if (name != kMetadataKey) {
      header.tensors.push_back(parse_tensor(path, name, entry, data_bytes));
      continue;
    }
    try {
      header.metadata = entry.get<std::map<std::string, std::string>>();
    } catch (const Json::exception&) {
      throw bad_file(path, "its __metadata__ is not a list of texts");
    }
  }
  refuse_deep_nesting(path, header.metadata);
  std::stable_sort(header.tensors.begin(), header.tensors.end(),
                   [](const auto& a, const auto& b) { return a.begin < b.begin; });
  std::uint64_t end = 0;
  for (StoredTensor& tensor : header.tensors) {
    if (tensor.begin != end) throw bad_file(path, "tensor '" + tensor.info.name + "' overlaps another or leaves a gap");
    end += tensor.value_count * sizeof(float);
    tensor.begin += data_begin;
  }
  if (end != data_bytes) {
    throw bad_file(
        path, "holds " + std::to_string(data_bytes) + " bytes of numbers, its header describes " + std::to_string(end));
  }
  return header;
}

std::vector<float> read_tensor(const fs::path& path, const StoredTensor& tensor) {
  std::ifstream file = open(path);
  std::vector<float> values(tensor.value_count);
  file.seekg(static_cast<std::streamoff>(tensor.begin));
  if (!file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(float)))) {
    throw bad_file(path, "tensor '" + tensor.info.name + "' cannot be read: the file is truncated");
  }
  if (!std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); })) {
    throw bad_file(path, "tensor '" + tensor.info.name + "' holds NaN or infinity");
  }
  return values;
}

void write_safetensors(const fs::path& path, const std::map<std::string, std::string>& metadata,
                       std::span<const TensorToStore> tensors) {
  refuse_deep_nesting(path, metadata);
  Json json;
  json[kMetadataKey] = metadata;
  std::size_t end = 0;
  for (const TensorToStore& tensor : tensors) {
    if (value_count(tensor.info) != tensor.values.size()) {
      throw core::Error(core::ErrorKind::kInternal,
                        "tensor '" + tensor.info.name + "' does not have the values its shape says");
    }
    const std::size_t begin = end;
    end += tensor.values.size_bytes();
    json[tensor.info.name] = {{"dtype", "F32"}, {"shape", tensor.info.shape}, {"data_offsets", {begin, end}}};
  }
  std::string text = json.dump();
  // Numbers begin at a multiple of 8 bytes, for readers that map the file.
  text.append((kLengthBytes - text.size() % kLengthBytes) % kLengthBytes, ' ');

  std::string bytes(kLengthBytes, '\0');
  const std::uint64_t length = text.size();
  std::memcpy(bytes.data(), &length, kLengthBytes);
  bytes.reserve(kLengthBytes + text.size() + end);
  bytes += text;
  for (const TensorToStore& tensor : tensors) {
    bytes.append(reinterpret_cast<const char*>(tensor.values.data()), tensor.values.size_bytes());
  }
  core::write_file_atomically(path, bytes);
}

}  // namespace lightstage::model
