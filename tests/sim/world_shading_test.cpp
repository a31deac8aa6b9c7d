#include <catch2/catch.hpp>
#include <numbers>

#include "core/sphere.h"
#include "sim/render/shading.h"

using namespace lightstage;
using sim::Vec3f;

namespace {

sim::SurfaceSample surface(float alpha, float f0, core::Vec3 to_viewer) {
  sim::SurfaceSample sample;
  sample.normal = {0, 0, 1};
  sample.to_viewer = Vec3f(to_viewer);
  sample.albedo = {1, 0.5F, 0.25F};
  sample.alpha = alpha;
  sample.f0 = f0;
  return sample;
}

// Radiance per unit gain at unit distance: pi cos f.
Vec3f radiance(const sim::SurfaceSample& sample, core::Vec3 to_light) {
  sim::LightSet lights;
  lights.add(Vec3f(to_light), 1, std::array{1.0, 1.0, 1.0}, 0);
  const float visible = 1;
  return sim::reflected_radiance(sample, lights, {&visible, 1});
}

core::Vec3 at_angle(double degrees, double around = 0) {
  const double a = core::radians_from_degrees(degrees), b = core::radians_from_degrees(around);
  return {std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)};
}

const std::vector<float> kAlphas{0.05F, 0.1F, 0.3F, 0.6F, 1};

}  // namespace

TEST_CASE("the reflectance is the same with light and viewer exchanged") {
  for (const float alpha : kAlphas) {
    for (const auto& [a, b, around] :
         {std::array{10.0, 70.0, 0.0}, {35.0, 50.0, 170.0}, {5.0, 85.0, 90.0}, {60.0, 61.0, 180.0}}) {
      const core::Vec3 u = at_angle(a), w = at_angle(b, around);
      const Vec3f forth = radiance(surface(alpha, 0.04F, u), w), back = radiance(surface(alpha, 0.04F, w), u);
      INFO("alpha " << alpha << ", angles " << a << " " << b);
      CHECK(double(forth.x) / w.z == Approx(double(back.x) / u.z).epsilon(2e-4));
      CHECK(double(forth.z) / w.z == Approx(double(back.z) / u.z).epsilon(2e-4));
    }
  }
}

TEST_CASE("no surface reflects more than it receives") {
  constexpr std::size_t kLights = 40000;
  sim::LightSet lights;
  for (const core::Direction& d : core::fibonacci_directions(kLights))
    lights.add(Vec3f(d.vec()), 1, std::array{1.0, 1.0, 1.0}, 0);
  const std::vector<float> visible(kLights, 1);
  for (const float alpha : {0.1F, 0.3F, 0.6F, 1.0F}) {
    for (const double angle : {0.0, 30.0, 60.0, 75.0, 85.0, 89.0}) {
      // The integral of f cos over the hemisphere: sum of radiance / pi times 4 pi / n.
      const Vec3f sum = sim::reflected_radiance(surface(alpha, 0.04F, at_angle(angle)), lights, visible);
      INFO("alpha " << alpha << ", viewer at " << angle << " degrees");
      CHECK(sum.x * 4 / float(kLights) < 1.002F);
      if (angle <= 30) CHECK(sum.x * 4 / float(kLights) > 0.85F);
    }
  }
  const Vec3f lambert = sim::reflected_radiance(surface(1, 0, at_angle(40)), lights, visible);
  CHECK(double(lambert.x) * 4 / kLights == Approx(1).epsilon(1e-3));
  CHECK(double(lambert.y) * 4 / kLights == Approx(0.5).epsilon(1e-3));
}

TEST_CASE("the specular lobe is GGX: its height at the mirror direction has a closed form") {
  // At n = l = v = h: pi D V F = f0 / (4 alpha^2); the diffuse part is albedo (1 - f0)^2.
  for (const float alpha : kAlphas) {
    const Vec3f seen = radiance(surface(alpha, 0.04F, {0, 0, 1}), {0, 0, 1});
    CHECK(double(seen.x) == Approx(0.04 / (4.0 * double(alpha) * double(alpha)) + 0.96 * 0.96).epsilon(1e-4));
  }
}

TEST_CASE("shading is finite at its limits") {
  for (const float alpha : kAlphas) {
    for (const double viewer : {0.0, 89.9999, 90.0, 120.0}) {
      for (const double light : {0.0, 89.9999, 90.0, 179.0}) {
        for (const double around : {0.0, 180.0}) {
          const Vec3f seen = radiance(surface(alpha, 0.04F, at_angle(viewer)), at_angle(light, around));
          INFO(alpha << " " << viewer << " " << light << " " << around);
          CHECK(std::isfinite(seen.x));
          CHECK(seen.x >= 0);
          if (light > 90) CHECK(seen.x == 0);
        }
      }
    }
  }
}

TEST_CASE("many lights at once are the sum of each, over odd counts") {
  const sim::SurfaceSample sample = surface(0.2F, 0.03F, at_angle(25, 40));
  for (const std::size_t count : {0u, 1u, 2u, 3u, 7u, 17u, 200u}) {
    sim::LightSet lights;
    std::vector<float> visible;
    core::Vec3 expected;
    for (const core::Direction& d : core::random_directions(count, 5)) {
      const float share = float(visible.size() % 3) / 2;
      lights.add(Vec3f(d.vec()), 1, std::array{1.0, 2.0, 0.5}, 0);
      visible.push_back(share);
      expected = expected + sim::to_double(radiance(sample, d.vec()) * Vec3f(1, 2, 0.5F)) * double(share);
    }
    const Vec3f seen = sim::reflected_radiance(sample, lights, visible);
    CHECK(double(seen.x) == Approx(expected.x).epsilon(1e-5));
    CHECK(double(seen.y) == Approx(expected.y).epsilon(1e-5));
    CHECK(double(seen.z) == Approx(expected.z).epsilon(1e-5));
  }
}
