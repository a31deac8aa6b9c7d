#include <catch2/catch.hpp>
#include <numbers>

#include "sim/render/sample_grid.h"
#include "sim/subjects/mirror.h"
#include "world_scene.h"

using namespace lightstage;
using core::Vec3;

namespace {

constexpr double kRadius = 0.06;

Vec3 unit(Vec3 v) {
  return v / core::norm(v);
}

// The reflection point by Fermat's principle: the shortest way over the visible part of the ball, by shrinking steps downhill.
Vec3 shortest_way(Vec3 viewer, Vec3 light) {
  const auto way = [&](Vec3 p) { return core::norm(viewer - p) + core::norm(light - p); };
  Vec3 best = unit(unit(viewer) + unit(light)) * kRadius;
  for (double step = 0.02; step > 1e-12; step *= 0.7) {
    for (int k = 0; k < 24; ++k) {
      const double a = 2 * std::numbers::pi * k / 24;
      const Vec3 side = unit(core::cross(best, {0.3, 0.5, 0.81})), up = core::cross(unit(best), side);
      const Vec3 tried = unit(best + (side * std::cos(a) + up * std::sin(a)) * step) * kRadius;
      if (way(tried) < way(best)) best = tried;
    }
  }
  return best;
}

struct Centroid {
  double x = 0, y = 0, total = 0;
};

Centroid centroid(const core::Image& image) {
  Centroid c;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      const double v = double(image(y, x, 1));
      c.total += v;
      c.x += v * x;
      c.y += v * y;
    }
  }
  c.x /= c.total;
  c.y /= c.total;
  return c;
}

// The slow way: fine rays around a place, reflected on the ball, tested against the disc, each seen through the pixel response.
core::Image by_rays(const core::CameraModel& camera, const sim::Lamp& lamp, core::Pixel place, double reach,
                    int across) {
  core::Image image(camera.height, camera.width, 3);
  const Vec3 axis = unit(lamp.position);
  double emitting = 0;
  const auto profile = [](double x) {
    const double edge = std::clamp((1 - x) / 0.2, 0.0, 1.0);
    return edge * edge * (3 - 2 * edge);
  };
  for (int i = 0; i < 4000; ++i) {
    const double x = (i + 0.5) / 4000;
    emitting += 2 * std::numbers::pi * x * profile(x) / 4000 * lamp.radius * lamp.radius;
  }
  const double radiance =
      sim::kMirrorReflectance * std::numbers::pi * lamp.gain[1] * core::dot(lamp.position, lamp.position) / emitting;
  const double step = 2 * reach / across;
  for (int j = 0; j < across; ++j) {
    for (int i = 0; i < across; ++i) {
      const core::Pixel at{place.x - reach + (i + 0.5) * step, place.y - reach + (j + 0.5) * step};
      const Vec3 origin = camera.centre(), ray = camera.ray(at);
      const double b = core::dot(origin, ray), c = core::dot(origin, origin) - kRadius * kRadius;
      if (b * b - c < 0) continue;
      const Vec3 point = origin + ray * (-b - std::sqrt(b * b - c)), normal = unit(point);
      const Vec3 out = ray - normal * (2 * core::dot(ray, normal));
      const double towards = core::dot(out, axis);
      if (towards <= 0) continue;
      const Vec3 hit = point + out * (core::dot(lamp.position - point, axis) / towards);
      const double value = radiance * profile(core::norm(hit - lamp.position) / lamp.radius) * step * step;
      if (value == 0) continue;
      for (int y = int(at.y) - 3; y <= int(at.y) + 3; ++y) {
        for (int x = int(at.x) - 3; x <= int(at.x) + 3; ++x) {
          if (x < 0 || y < 0 || x >= camera.width || y >= camera.height) continue;
          image(y, x, 1) += float(value * sim::pixel_response(x - at.x) * sim::pixel_response(y - at.y));
        }
      }
    }
  }
  return image;
}

sim::Lamp lamp_at(double longitude, double latitude) {
  const Vec3 direction = core::Direction::from_longitude_latitude_degrees(longitude, latitude).vec();
  return {direction * 1.5, 0.012, {0.5, 1.25, 2}};
}

core::CameraModel lens(int pixels, bool distorted) {
  core::CameraModel camera = core::look_at({0.05, -0.03, 1.9}, {0, 0, 0}, pixels, pixels, 9.0);
  if (distorted) {
    camera.k1 = 1.5;
    camera.p1 = 0.02;
  }
  return camera;
}

const std::vector<std::pair<double, double>> kPlaces{{0, 8}, {20, -10}, {-60, 30}, {100, 5}, {-30, 80}, {150, -20}};

}  // namespace

TEST_CASE("reflection points take the shortest way") {
  const Vec3 viewer{0.05, -0.03, 1.9};
  for (const auto& [longitude, latitude] : kPlaces) {
    const Vec3 light = lamp_at(longitude, latitude).position;
    const std::optional<Vec3> found = sim::reflection_point(kRadius, viewer, light);
    REQUIRE(found);
    CHECK(core::norm(*found - shortest_way(viewer, light)) < 1e-7);
    // Equal angles, in one plane.
    const Vec3 n = unit(*found), in = unit(viewer - *found), out = unit(light - *found);
    CHECK(core::norm(n * (2 * core::dot(n, in)) - in - out) < 1e-12);
  }
}

TEST_CASE("reflection points at the limits: before the viewer's eye, and hidden behind the ball") {
  const Vec3 viewer{0, 0, 1.9};
  const std::optional<Vec3> straight = sim::reflection_point(kRadius, viewer, {0, 0, 1.5});
  REQUIRE(straight);
  CHECK(core::norm(*straight - Vec3{0, 0, kRadius}) < 1e-15);
  CHECK_FALSE(sim::reflection_point(kRadius, viewer, {0, 0, -1.5}));
  CHECK_FALSE(sim::reflection_point(kRadius, viewer, {0.01, 0, -1.5}));
  CHECK(sim::reflection_point(kRadius, viewer, {0.3, 0, -1.5}));
}

TEST_CASE("a highlight's centroid is the reflection point's pixel to 0.02 pixels") {
  for (const bool distorted : {false, true}) {
    for (const int pixels : {128, 255, 512}) {
      const core::CameraModel camera = lens(pixels, distorted);
      for (const auto& [longitude, latitude] : kPlaces) {
        const sim::Lamp lamp = lamp_at(longitude, latitude);
        core::Image image(pixels, pixels, 3);
        sim::add_reflections(image, camera, kRadius, {&lamp, 1});
        const core::Pixel expected = *camera.project(shortest_way(camera.centre(), lamp.position));
        const Centroid found = centroid(image);
        INFO(pixels << " pixels, light at " << longitude << " " << latitude);
        CHECK(std::hypot(found.x - expected.x, found.y - expected.y) < 0.02);
      }
    }
  }
}

TEST_CASE("highlights have the strength and shape that tracing fine rays gives") {
  const core::CameraModel camera = lens(200, true);
  for (const auto& [longitude, latitude] : kPlaces) {
    const sim::Lamp lamp = lamp_at(longitude, latitude);
    core::Image fast(200, 200, 3);
    sim::add_reflections(fast, camera, kRadius, {&lamp, 1});
    const core::Pixel place = *camera.project(shortest_way(camera.centre(), lamp.position));
    const core::Image slow = by_rays(camera, lamp, place, 0.6, 240);
    double largest = 0, difference = 0;
    for (int y = 0; y < 200; ++y) {
      for (int x = 0; x < 200; ++x) {
        largest = std::max(largest, double(slow(y, x, 1)));
        difference = std::max(difference, std::abs(double(slow(y, x, 1)) - double(fast(y, x, 1))));
      }
    }
    INFO("light at " << longitude << " " << latitude);
    CHECK(largest > 1);
    CHECK(difference < 0.01 * largest);
    CHECK(centroid(fast).total == Approx(centroid(slow).total).epsilon(0.005));
    CHECK(double(fast(int(std::lround(place.y)), int(std::lround(place.x)), 0)) ==
          Approx(0.4 * double(fast(int(std::lround(place.y)), int(std::lround(place.x)), 1))));
  }
}

TEST_CASE("a lamp straight behind the ball and one off the picture do no harm") {
  const core::CameraModel camera = core::look_at({0, 0, 1.9}, {0, 0, 0}, 64, 64, 9.0);
  for (const Vec3 position : {Vec3{0, 0, -1.5}, Vec3{0.12, 0, -1.49}, Vec3{0, 0, 1.5}}) {
    const sim::Lamp lamp{position, 0.012, {1, 1, 1}};
    core::Image image(64, 64, 3);
    sim::add_reflections(image, camera, kRadius, {&lamp, 1});
    for (const float v : image.values()) CHECK((std::isfinite(v) && v >= 0));
  }
  const core::CameraModel aside = core::look_at({0, 0, 1.9}, {0.5, 0, 0}, 64, 64, 9.0);
  const sim::Lamp lamp = lamp_at(20, 20);
  core::Image image(64, 64, 3);
  sim::add_reflections(image, aside, kRadius, {&lamp, 1});
  CHECK(test::largest_value(image) == 0);
}

TEST_CASE("the mirror ball in the world: highlights at the true lights, a silhouette on black under all of them") {
  sim::Simulation simulation = test::still_simulation(sim::SubjectKind::kMirrorBall, 60, 160);
  simulation.stage.simulation.mount_error_degrees = 2;
  const sim::World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const capture::LightLevel level{17};
  const core::Image one = world.render(camera, {&level, 1}, 0);
  const core::Pixel expected = *camera.project(shortest_way(camera.centre(), *world.true_lights()[17].position));
  const auto brightest = std::max_element(one.values().begin(), one.values().end()) - one.values().begin();
  CHECK(std::abs(double(brightest / 3 % 160) - expected.x) <= 0.51);
  CHECK(std::abs(double(brightest / 3 / 160) - expected.y) <= 0.51);

  const core::Image full = world.render(camera, test::all_lights(world), 0);
  const double radius = camera.fx * kRadius / std::sqrt(1.9 * 1.9 - kRadius * kRadius);
  for (int y = 0; y < 160; ++y) {
    for (int x = 0; x < 160; ++x) {
      const double distance = std::hypot(x - camera.cx, y - camera.cy);
      if (distance > radius + 3) CHECK(full(y, x, 1) < 1e-3F);
      if (distance < radius - 3) CHECK(full(y, x, 1) > 0.3F);
    }
  }
}

TEST_CASE("a mirror ball that stands aside shows the lights from there, and a grey one their light") {
  const core::Vec3 place{0.06, -0.04, 0.05};
  sim::Simulation simulation = test::still_simulation(sim::SubjectKind::kMirrorBall, 60, 160);
  simulation.subject.position = place;
  const sim::World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const core::Vec3 light = *world.true_lights()[17].position;
  const capture::LightLevel level{17};
  const core::Image one = world.render(camera, {&level, 1}, 0);
  const core::Pixel expected = *camera.project(shortest_way(camera.centre() - place, light - place) + place);
  const auto brightest = std::max_element(one.values().begin(), one.values().end()) - one.values().begin();
  CHECK(std::abs(double(brightest / 3 % 160) - expected.x) <= 0.51);
  CHECK(std::abs(double(brightest / 3 / 160) - expected.y) <= 0.51);

  simulation.subject.kind = sim::SubjectKind::kGreyBall;
  simulation.subject.albedo = 0.5;
  const sim::World grey(simulation);
  int compared = 0;
  for (std::size_t i = 0; i < grey.true_lights().size(); ++i) {
    const core::Light& lamp = grey.true_lights()[i];
    // The point between the directions to the camera and to the light.
    const core::Vec3 to_light = *lamp.position - place, to_camera = camera.centre() - place;
    const core::Vec3 sum = to_light / norm(to_light) + to_camera / norm(to_camera);
    const core::Vec3 normal = sum / norm(sum), point = place + normal * kRadius;
    const core::Vec3 way = *lamp.position - point;
    const double cosine = dot(normal, way) / norm(way);
    if (cosine < 0.7) continue;  // nearer the rim half a pixel's rounding matters
    const double radiance = 0.5 * cosine * dot(*lamp.position, *lamp.position) / dot(way, way) * lamp.gain[1];
    const core::Pixel seen = *camera.project(point);
    const capture::LightLevel lamp_level{int(i)};
    const core::Image lit = grey.render(camera, {&lamp_level, 1}, 0);
    INFO("light " << i << ", cosine " << cosine);
    CHECK(lit(int(std::lround(seen.y)), int(std::lround(seen.x)), 1) == Approx(radiance).epsilon(0.03));
    ++compared;
  }
  CHECK(compared >= 10);
}
