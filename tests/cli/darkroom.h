// A store with one scan, `ball`: 24 small pictures; and models trained on it.
#pragma once

#include <filesystem>
#include <fstream>

#include <catch2/catch.hpp>

#include "cli/program.h"
#include "core/image_file.h"
#include "core/sphere.h"
#include "support/support.h"

namespace lightstage::test {

class Darkroom {
 public:
  Darkroom() {
    const auto lights = core::fibonacci_directions(24);
    std::ofstream list(folder_ / "dirs.lp");
    list << lights.size() << "\n";
    for (std::size_t i = 0; i < lights.size(); ++i) {
      core::Image picture(20, 18, 3);
      for (int y = 0; y < 20; ++y) {
        for (int x = 0; x < 18; ++x) {
          const double slope_x = (x - 9) / 10.0, slope_y = (10 - y) / 11.0;
          const double cosine = slope_x * lights[i].x() + slope_y * lights[i].y() + 0.6 * lights[i].z();
          for (int c = 0; c < 3; ++c) picture(y, x, c) = float(std::max(0.02, cosine * (1 - 0.2 * c)));
        }
      }
      const std::string name = "p" + std::to_string(i) + ".exr";
      core::write_image(folder_ / name, picture);
      list << name << " " << lights[i].x() << " " << lights[i].y() << " " << lights[i].z() << "\n";
    }
    list.close();
    REQUIRE(run({"init"}).status == 0);
    REQUIRE(run({"import", "lp", *this / "dirs.lp", "--name", "ball", "--quiet"}).status == 0);
  }

  Outcome run(std::vector<std::string> arguments) const { return run_program(folder_ / "store", std::move(arguments)); }

  Outcome train(const std::string& out, std::vector<std::string> more) const {
    std::vector<std::string> arguments{"train", "ball", "--out", *this / out, "--threads", "1", "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run(arguments);
  }

  std::filesystem::path store() const { return folder_ / "store"; }
  std::string operator/(const std::string& name) const { return (folder_ / name).string(); }

 private:
  TemporaryFolder folder_;
};

inline nlohmann::json show(const Darkroom& darkroom, const std::string& file) {
  const Outcome outcome = darkroom.run({"model", "show", file, "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  return outcome.json();
}

}  // namespace lightstage::test
