// The response of a camera as a file: CSV with a line `code,red,green,blue` for each of 256 codes.
#pragma once

#include <filesystem>

#include "calib/response.h"

namespace lightstage::cli {

void write_response(const std::filesystem::path& path, const calib::CameraResponse& response);
// Throws BadInput with file and line for anything that is not what write_response writes.
calib::CameraResponse read_response(const std::filesystem::path& path);

}  // namespace lightstage::cli
