#include "db/scene.h"

#include <cmath>
#include <fstream>
#include <sstream>

#include "core/sphere.h"

namespace lightstage::test {

namespace fs = std::filesystem;

core::Image lit_ball(const core::Direction& light, int height, int width, int channels) {
  core::Image image(height, width, channels);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double u = (2.0 * x + 1 - width) / width, v = (height - 1 - 2.0 * y) / height;
      const double r2 = u * u + v * v;
      if (r2 >= 1) continue;
      const core::Vec3 bumps{0.15 * std::sin(7 * u + v), 0.15 * std::cos(5 * v - 2 * u), 0};
      const core::Direction normal = core::Direction::from_vector(core::Vec3{u, v, std::sqrt(1 - r2)} + bumps);
      const double albedo = std::hypot(u - 0.3, v + 0.2) < 0.25 ? 0.2 : 0.7;
      const double shade = albedo * std::max(0.0, core::dot(normal.vec(), light.vec())) + 0.01;
      for (int c = 0; c < channels; ++c) image(y, x, c) = float(shade * (1 - 0.1 * c));
    }
  }
  return image;
}

core::Image half_pattern(int height, int width, int channels, int seed) {
  core::Image image(height, width, channels);
  int i = seed * 37;
  for (float& value : image.values()) value = float(i++ % 257) / 256.0F;
  return image;
}

std::vector<core::Direction> front_lights(std::size_t count) {
  std::vector<core::Direction> front;
  for (const core::Direction& d : core::fibonacci_directions(2 * count)) {
    if (d.z() > 0 && front.size() < count) front.push_back(d);
  }
  return front;
}

db::NewScan olat_scan(const std::string& name, std::size_t lights) {
  db::NewScan scan;
  scan.name = name;
  scan.stage_key = "stage";
  scan.cameras = {"main"};
  for (std::size_t i = 0; i < lights; ++i) {
    scan.steps.push_back(
        {.step_index = int(i), .kind = db::StepKind::kLight, .light_index = int(i), .exposure_ns = 20'000'000});
  }
  return scan;
}

std::map<std::string, std::string> snapshot(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    files[fs::relative(entry.path(), folder).string()] = entry.is_regular_file() ? read_text(entry.path()) : "";
  }
  return files;
}

void write_text(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

std::string read_text(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

}  // namespace lightstage::test
