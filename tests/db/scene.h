// Small pictures and scans for the tests of the store.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "db/store.h"

namespace lightstage::test {

// A matte ball with an uneven surface and a spot, seen from +z under one distant light: shading that says
// where the light is.
core::Image lit_ball(const core::Direction& light, int height, int width, int channels = 3);

// Values that half floats hold exactly.
core::Image half_pattern(int height, int width, int channels, int seed);

// Directions of the half sphere towards the camera.
std::vector<core::Direction> front_lights(std::size_t count);

// A scan of `lights` lights with one camera "main" and no frames yet.
db::NewScan olat_scan(const std::string& name, std::size_t lights);

// Every file below the folder with its bytes.
std::map<std::string, std::string> snapshot(const std::filesystem::path& folder);

void write_text(const std::filesystem::path& path, const std::string& text);
std::string read_text(const std::filesystem::path& path);

// What the expression's core::Error says; empty when nothing is thrown.
template <class Work>
std::string message_of(Work&& work) {
  try {
    work();
  } catch (const std::exception& error) {
    return error.what();
  }
  return {};
}

}  // namespace lightstage::test
