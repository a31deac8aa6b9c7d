// Small scenes for tests of the simulated world.
#pragma once

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/sphere.h"
#include "sim/world.h"

namespace lightstage::test {

inline constexpr double kCameraDistance = 1.9;

// A stage of `lights` Fibonacci lights (possibly none) at 1.5 m, true to its drawing, and one camera on +z that sees 0.3 m across.
inline sim::Simulation still_simulation(sim::SubjectKind kind, std::size_t lights, int pixels) {
  sim::Simulation simulation;
  simulation.stage.name = "test";
  for (const core::Direction& direction :
       lights > 0 ? core::fibonacci_directions(lights) : std::vector<core::Direction>()) {
    simulation.stage.light_positions.push_back(direction.vec() * simulation.stage.radius_m);
  }
  const core::CameraModel camera = core::look_at({0, 0, kCameraDistance}, {0, 0, 0}, pixels, pixels, 9.0);
  simulation.stage.cameras.push_back({"front", camera, 1.0});
  simulation.subject.kind = kind;
  simulation.motion = {.amplitude_m = 0, .rotation_degrees = 0};
  return simulation;
}

inline const core::CameraModel& camera_of(const sim::World& world) {
  return world.simulation().stage.cameras[0].model;
}

inline std::vector<capture::LightLevel> all_lights(const sim::World& world) {
  std::vector<capture::LightLevel> levels;
  for (std::size_t i = 0; i < world.true_lights().size(); ++i) levels.push_back({int(i)});
  return levels;
}

inline double largest_difference(const core::Image& a, const core::Image& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i) {
    largest = std::max(largest, std::abs(double(a.values()[i]) - double(b.values()[i])));
  }
  return largest;
}

inline double largest_value(const core::Image& image) {
  return double(*std::max_element(image.values().begin(), image.values().end()));
}

// Peak signal-to-noise ratio in decibels; the peak is the largest value of the truth.
inline double psnr(const core::Image& estimate, const core::Image& truth) {
  double sum = 0;
  for (std::size_t i = 0; i < truth.values().size(); ++i) {
    const double d = double(estimate.values()[i]) - double(truth.values()[i]);
    sum += d * d;
  }
  const double peak = largest_value(truth);
  return 10 * std::log10(peak * peak * double(truth.values().size()) / sum);
}

inline void write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

// Two parallel squares facing +z as an OBJ file: a wall 0.24 m wide and, `gap` metres before it, a plate 0.06 m wide.
inline void write_wall_and_plate(const std::filesystem::path& path, double gap) {
  const auto square = [](double half, double z) {
    std::string text;
    for (const auto& [x, y] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
      text += "v " + std::to_string(half * x) + " " + std::to_string(half * y) + " " + std::to_string(z) + "\n";
    }
    return text;
  };
  write_text(path, square(0.12, 0) + square(0.03, gap) + "f 1 2 3 4\nf 5 6 7 8\n");
}

// A globe of triangles with vertex normals, as an OBJ file; `inwards` turns normals and triangles round.
inline void write_globe(const std::filesystem::path& path, double radius, int bands, bool inwards) {
  std::string text;
  for (int j = 0; j <= bands; ++j) {
    for (int i = 0; i < 2 * bands; ++i) {
      const double polar = M_PI * j / bands, around = M_PI * i / bands;
      const double x = std::sin(polar) * std::cos(around), y = std::cos(polar), z = std::sin(polar) * std::sin(around);
      const double sign = inwards ? -1 : 1;
      text += "v " + std::to_string(radius * x) + " " + std::to_string(radius * y) + " " + std::to_string(radius * z) +
              "\n";
      text += "vn " + std::to_string(sign * x) + " " + std::to_string(sign * y) + " " + std::to_string(sign * z) + "\n";
    }
  }
  const auto corner = [bands](int j, int i) {
    const std::string n = std::to_string(j * 2 * bands + i % (2 * bands) + 1);
    return " " + n + "//" + n;
  };
  for (int j = 0; j < bands; ++j) {
    for (int i = 0; i < 2 * bands; ++i) {
      const std::string a = corner(j, i), b = corner(j, i + 1), c = corner(j + 1, i + 1), d = corner(j + 1, i);
      if (j > 0) text += inwards ? "f" + a + c + b + "\n" : "f" + a + b + c + "\n";
      if (j + 1 < bands) text += inwards ? "f" + a + d + c + "\n" : "f" + a + c + d + "\n";
    }
  }
  write_text(path, text);
}

}  // namespace lightstage::test
