#include "cli/report/response_file.h"

#include <cmath>

#include "core/error.h"
#include "core/file.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

constexpr std::size_t kCodes = 256;
constexpr const char* kHeader = "code,red,green,blue";

}  // namespace

void write_response(const std::filesystem::path& path, const calib::CameraResponse& response) {
  std::string text = std::string(kHeader) + "\n";
  for (std::size_t k = 0; k < kCodes; ++k) {
    text += std::to_string(k);
    for (const std::vector<double>& curve : response.curve) text += "," + core::number_text(curve[k]);
    text += "\n";
  }
  core::write_file_atomically(path, text);
}

calib::CameraResponse read_response(const std::filesystem::path& path) {
  const std::string text = core::read_text_file(path);
  calib::CameraResponse response;
  std::size_t line_number = 0;
  for (const std::string_view raw : core::split(text, '\n')) {
    ++line_number;
    const std::string_view line = core::trim(raw);
    const std::string place = path.string() + ":" + std::to_string(line_number);
    if (line.empty()) continue;
    if (line_number == 1) {
      if (line != kHeader)
        throw core::BadInput(place + ": must be `" + kHeader + "`, as `calibrate response` writes it");
      continue;
    }
    const std::vector<std::string_view> fields = core::split(line, ',');
    const std::size_t code = response.curve[0].size();
    if (fields.size() != 4 || core::parse_integer(fields[0]) != std::int64_t(code) || code >= kCodes) {
      throw core::BadInput(place + ": must be code " + std::to_string(code) + " and three numbers");
    }
    for (std::size_t c = 0; c < 3; ++c) {
      const std::optional<double> value = core::parse_number(fields[c + 1]);
      std::vector<double>& curve = response.curve[c];
      if (!value || !(*value >= 0) || !std::isfinite(*value) || (!curve.empty() && *value < curve.back())) {
        throw core::BadInput(place + ": '" + std::string(fields[c + 1]) + "' is no exposure, or falls");
      }
      curve.push_back(*value);
    }
  }
  if (response.curve[0].size() != kCodes) throw core::BadInput(path.string() + ": must hold 256 codes");
  return response;
}

}  // namespace lightstage::cli
