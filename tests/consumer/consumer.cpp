// Another project's use of the libraries: relights a made-up scan of four lights.
#include <cstdio>

#include "core/olat_scan.h"
#include "model/classical.h"
#include "relight/relight.h"

int main() {
  using namespace lightstage;
  std::vector<core::Light> lights;
  for (const core::Vec3 v : {core::Vec3{1, 0, 1}, {-1, 0, 1}, {0, 1, 1}, {0, -1, 1}}) {
    lights.push_back({.direction = core::Direction::from_vector(v)});
  }
  const core::OlatScan scan("four", lights, {2, 2, 3}, {}, [](std::size_t i) {
    core::Image image(2, 2, 3);
    for (float& value : image.values()) value = float(i + 1);
    return image;
  });
  const auto blend = model::make_linear_blend(scan, 4, 10, model::Domain::kLinear);
  const relight::RelightReport lit = relight::relight_direction(*blend, core::Direction());
  std::printf("%.3f\n", double(lit.image(0, 0, 0)));
  return lit.image(0, 0, 0) == 2.5f ? 0 : 1;  // all four lights are equally far
}
