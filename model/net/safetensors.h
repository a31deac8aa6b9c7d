// Safetensors files of float32 tensors: 8 bytes that give the length of a JSON header, the header, then the numbers. Nothing in one can
// be executed, and everything that is read is checked against the size of the file first. The format is described in the
// documentation of the safetensors library ("Format").
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "model/checkpoint.h"

namespace lightstage::model {

// A tensor's numbers stand row-major, little-endian, in [begin, begin + 4 * value_count) of the file.
struct StoredTensor {
  TensorInfo info;
  std::size_t begin = 0;
  std::size_t value_count = 0;
};

struct SafetensorsHeader {
  std::map<std::string, std::string> metadata;
  std::vector<StoredTensor> tensors;  // as they follow each other in the file, without gaps
};

// Reads the header alone. Throws BadInput naming the file, and the tensor where one is to blame, when the file is missing, truncated or
// longer than its header says, when the header is no JSON of this format or larger than 16 MiB, for types other than F32, for two entries of one name, and for
// metadata of which a text has more than 500 brackets open at a time, so that JSON in it can be walked through without fear.
SafetensorsHeader read_safetensors_header(const std::filesystem::path& path);

// The numbers of one tensor of that header. Throws BadInput when the file has become shorter, or holds NaN or infinity there.
std::vector<float> read_tensor(const std::filesystem::path& path, const StoredTensor& tensor);

struct TensorToStore {
  TensorInfo info;
  std::span<const float> values;
};

// Writes atomically (core/file.h). Tensors stand in the order given. Throws BadInput for metadata that could not be read again.
void write_safetensors(const std::filesystem::path& path, const std::map<std::string, std::string>& metadata,
                       std::span<const TensorToStore> tensors);

// The product of the dimensions.
std::size_t value_count(const TensorInfo& info);

}  // namespace lightstage::model
