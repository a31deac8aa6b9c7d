#include <catch2/catch.hpp>
#include <condition_variable>
#include <mutex>
#include <numbers>
#include <set>
#include <thread>

#include "core/error.h"
#include "core/parallel.h"
#include "support/support.h"
#include "world_scene.h"

using namespace lightstage;
using sim::SubjectKind;
using sim::World;

namespace {

struct ThreadCount {
  explicit ThreadCount(int n) { core::set_thread_count(n); }
  ~ThreadCount() { core::set_thread_count(0); }
};

sim::Simulation mesh_simulation(const std::filesystem::path& mesh, double height, std::size_t lights, int pixels) {
  sim::Simulation simulation = test::still_simulation(SubjectKind::kMesh, lights, pixels);
  simulation.subject.mesh_path = mesh.string();
  simulation.subject.size_m = height;
  return simulation;
}

}  // namespace

TEST_CASE("a Lambertian ball under one light has the closed form's radiance") {
  sim::Simulation simulation = test::still_simulation(SubjectKind::kGreyBall, 0, 256);
  simulation.stage.light_positions = {{0.5, 0.7, 0.9}};
  simulation.stage.simulation.gain_spread = 0.3;
  simulation.subject.albedo = 0.4;
  const World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const core::Light light = world.true_lights()[0];
  const core::Image image = world.render(camera, test::all_lights(world), 0);
  int compared = 0;
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) {
      const core::Vec3 ray = camera.ray({double(x), double(y)});
      const double b = core::dot(camera.centre(), ray);
      const double c = core::dot(camera.centre(), camera.centre()) - 0.06 * 0.06;
      if (b * b - c < 0) continue;
      const core::Vec3 point = camera.centre() + ray * (-b - std::sqrt(b * b - c));
      const core::Vec3 normal = point / 0.06, to_light = *light.position - point;
      const double r = core::norm(to_light), cosine = core::dot(normal, to_light) / r;
      // Away from silhouette and terminator, where the pixel's breadth matters.
      if (core::dot(normal, -ray) < 0.6 || std::abs(cosine) < 0.2) continue;
      const double d2 = core::dot(*light.position, *light.position);
      for (std::size_t k = 0; k < 3; ++k) {
        const double expected = cosine > 0 ? 0.4 * light.gain[k] * cosine * d2 / (r * r) : 0;
        CHECK(double(image.pixel(y, x)[k]) == Approx(expected).epsilon(0.003).margin(1e-12));
      }
      ++compared;
    }
  }
  CHECK(compared > 2000);
}

TEST_CASE("coverage is the share of each pixel: it sums to the area of the silhouette") {
  for (const int samples : {4, 9}) {
    sim::Simulation simulation = test::still_simulation(SubjectKind::kGreyBall, 1, 101);
    simulation.pixel_samples = samples;
    const World world(simulation);
    const core::Image covered = world.coverage(test::camera_of(world), 0);
    double area = 0;
    for (const float v : covered.values()) {
      CHECK(v >= 0);
      CHECK(v <= 1);
      area += double(v);
    }
    const double d = test::kCameraDistance, radius = test::camera_of(world).fx * 0.06 / std::sqrt(d * d - 0.06 * 0.06);
    CHECK(area == Approx(std::numbers::pi * radius * radius).epsilon(0.004));
    CHECK(covered(50, 50) == Approx(1));
    CHECK(covered(0, 0) == 0);
  }
}

TEST_CASE("a plate before a wall casts its shadow where geometry puts it") {
  const test::TemporaryFolder folder;
  constexpr double kGap = 0.05;
  test::write_wall_and_plate(folder / "wall.obj", kGap);
  sim::Simulation simulation = mesh_simulation(folder / "wall.obj", 0.24, 0, 120);
  simulation.stage.light_positions = {{1.0, 0, 1.1}};
  const World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const core::Image image = world.render(camera, test::all_lights(world), 0);
  // The mesh is centred: the wall at -gap/2. The plate's points p throw their shadow to light + (p - light) s.
  const core::Vec3 light{1.0, 0, 1.1};
  const auto seen = [&](double x, double y) {
    const core::Pixel p = *camera.project({x, y, -kGap / 2});
    return image(int(std::lround(p.y)), int(std::lround(p.x)), 1);
  };
  const double s = (light.z + kGap / 2) / (light.z - kGap / 2);
  const double middle = light.x + (0 - light.x) * s, half = 0.03 * s;
  CHECK(middle < -0.04);
  for (const double inside : {-0.8, -0.5}) CHECK(seen(middle + inside * half, 0.8 * half) == 0);
  CHECK(seen(middle - 1.2 * half, 0) > 0.1F);
  CHECK(seen(middle, 1.2 * half) > 0.1F);
  CHECK(seen(-middle, 0) > 0.1F);
}

TEST_CASE("smooth meshes show no shadow of their own triangles, and no light on the far side") {
  const test::TemporaryFolder folder;
  test::write_globe(folder / "globe.obj", 0.1, 12, false);  // coarse: triangles 15 degrees wide
  sim::Simulation simulation = mesh_simulation(folder / "globe.obj", 0.2, 0, 64);
  // The terminator runs through the middle of a column of facets whose flat sides already face away.
  const core::Vec3 light{1.5 * std::cos(core::radians_from_degrees(10)), 0,
                         1.5 * std::sin(core::radians_from_degrees(10))};
  simulation.stage.light_positions = {light};
  const World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const core::Image image = world.render(camera, test::all_lights(world), 0);
  int lit = 0, dark = 0;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const core::Vec3 ray = camera.ray({double(x), double(y)});
      const core::Vec3 nearest = camera.centre() - ray * core::dot(camera.centre(), ray);
      const double miss = core::norm(nearest);
      if (miss > 0.085) continue;
      const core::Vec3 normal = (nearest - ray * std::sqrt(0.01 - miss * miss)) / 0.1;
      const core::Vec3 to_light = light - normal * 0.1;
      const double cosine = core::dot(normal, to_light) / core::norm(to_light);
      INFO("pixel " << x << " " << y << ", cosine " << cosine);
      if (cosine > 0.03) {
        // The loader's albedo is 0.6, less by Fresnel; facets that shadowed themselves would be dark up to a cosine of 0.1.
        const double fresnel = 0.04 + 0.96 * std::pow(1 - cosine, 5);
        CHECK(double(image(y, x, 1)) > 0.6 * 0.6 * cosine * (1 - fresnel));
        ++lit;
      } else if (cosine < -0.15) {
        CHECK(image(y, x, 1) == 0);
        ++dark;
      }
    }
  }
  CHECK(lit > 300);
  CHECK(dark > 300);
}

TEST_CASE("one bounce inside an integrating sphere is even and of the closed form's strength") {
  const test::TemporaryFolder folder;
  test::write_globe(folder / "globe.obj", 0.125, 40, true);
  sim::Simulation simulation = mesh_simulation(folder / "globe.obj", 0.25, 0, 24);
  simulation.stage.light_positions = {{0.03, 0.02, -0.01}};
  core::CameraModel camera = core::look_at({0, 0, 0.06}, {0, 0, 0}, 24, 24, 60);
  const World direct(simulation);
  simulation.indirect_bounce = true;
  const World both(simulation);
  const core::Image first = direct.render(camera, test::all_lights(direct), 0);
  const core::Image second = both.render(camera, test::all_lights(both), 0);
  // A lamp of intensity pi g d^2 in a ball of radius r and albedo rho: the light once scattered arrives evenly as rho pi g d^2 / r^2,
  // wherever the lamp is, and leaves as rho^2 g d^2 / r^2. rho is 0.6 where an OBJ file names no material.
  const double d2 = 0.03 * 0.03 + 0.02 * 0.02 + 0.01 * 0.01, scale = d2 / (0.125 * 0.125);
  double sum = 0, low = 1e9, high = 0;
  for (std::size_t i = 0; i < first.values().size(); ++i) {
    const double bounce = double(second.values()[i]) - double(first.values()[i]);
    sum += bounce;
    low = std::min(low, bounce);
    high = std::max(high, bounce);
  }
  const double rho = std::sqrt(sum / double(first.values().size()) / scale);
  INFO("albedo by bounce " << rho);
  CHECK(rho == Approx(0.6).epsilon(0.01));
  CHECK(high / low < 1.5);
}

TEST_CASE("lights add up, exactly where shadows are exact") {
  for (const SubjectKind kind : {SubjectKind::kProceduralHead, SubjectKind::kMirrorBall, SubjectKind::kGreyBall}) {
    const World world(test::still_simulation(kind, 12, 40));
    const core::CameraModel& camera = test::camera_of(world);
    const std::vector<capture::LightLevel> both{{2, 0.5F, 1, 0.25F}, {7}};
    const core::Image a = world.render(camera, {both.data(), 1}, 0), b = world.render(camera, {both.data() + 1, 1}, 0);
    core::Image sum = a;
    for (std::size_t i = 0; i < sum.values().size(); ++i) sum.values()[i] += b.values()[i];
    CHECK(test::largest_value(sum) > 0.01);
    CHECK(test::largest_difference(world.render(camera, both, 0), sum) < 1e-5 * test::largest_value(sum));
    CHECK(test::largest_value(world.render(camera, {}, 0)) == 0);
  }
}

TEST_CASE("interpolated shadows of many lights stay near the exact sum of single lights") {
  sim::Simulation simulation = test::still_simulation(SubjectKind::kProceduralHead, 60, 72);
  simulation.motion = {};
  const World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const std::vector<capture::LightLevel> levels = test::all_lights(world);
  const core::Nanoseconds t = 4 * core::kSecond;  // away from the rest pose
  core::Image sum(72, 72, 3);
  for (const capture::LightLevel& level : levels) {
    const core::Image one = world.render(camera, {&level, 1}, t);
    for (std::size_t i = 0; i < sum.values().size(); ++i) sum.values()[i] += one.values()[i];
  }
  const double db = test::psnr(world.render(camera, levels, t), sum);
  INFO("PSNR " << db);
  CHECK(db > 35);
}

TEST_CASE("off-grid truth is what a stage light in that place would give") {
  const World world(test::still_simulation(SubjectKind::kProceduralHead, 9, 40));
  std::vector<core::Direction> directions;
  for (const core::Light& light : world.true_lights()) directions.push_back(light.direction);
  const std::vector<core::Image> truth = world.render_directions(test::camera_of(world), directions, 0);
  REQUIRE(truth.size() == 9);
  for (int i = 0; i < 9; ++i) {
    const capture::LightLevel level{i};
    const core::Image stage = world.render(test::camera_of(world), {&level, 1}, 0);
    CHECK(test::largest_difference(truth[std::size_t(i)], stage) <= 1e-5 * std::max(test::largest_value(stage), 1.0));
  }
}

TEST_CASE("pictures do not depend on the thread count, bit for bit") {
  const auto pictures = [](int threads) {
    const ThreadCount count(threads);
    sim::Simulation simulation = test::still_simulation(SubjectKind::kProceduralHead, 20, 33);
    simulation.indirect_bounce = true;
    simulation.motion = {};
    const World world(simulation);
    const core::CameraModel& camera = test::camera_of(world);
    const capture::LightLevel one{4};
    std::vector<core::Image> result{world.render(camera, {&one, 1}, 7),
                                    world.render(camera, test::all_lights(world), 7), world.coverage(camera, 7)};
    return result;
  };
  const std::vector<core::Image> alone = pictures(1);
  CHECK(test::largest_value(alone[0]) > 0.01);
  for (const int threads : {2, 5}) CHECK(pictures(threads) == alone);
}

TEST_CASE("a world leaves other loops their threads") {
  const ThreadCount count(3);
  const World world(test::still_simulation(SubjectKind::kChessboard, 1, 8));
  std::mutex mutex;
  std::condition_variable arrived;
  std::set<std::thread::id> threads;
  // On a machine with much else to do the second thread may come late.
  core::parallel_for(3, 1, [&](std::size_t, std::size_t) {
    std::unique_lock lock(mutex);
    threads.insert(std::this_thread::get_id());
    arrived.notify_all();
    arrived.wait_for(lock, std::chrono::seconds(20), [&] { return threads.size() > 1; });
  });
  CHECK(threads.size() > 1);
}

TEST_CASE("pictures may be asked for from several threads at once") {
  const World world(test::still_simulation(SubjectKind::kGreyBall, 40, 24));
  const core::CameraModel& camera = test::camera_of(world);
  const std::vector<capture::LightLevel> levels = test::all_lights(world);
  const core::Image expected = world.render(camera, levels, 0);
  const World fresh(world.simulation());
  std::vector<core::Image> images(8);
  core::parallel_for(8, 1, [&](std::size_t i, std::size_t) { images[i] = fresh.render(camera, levels, 0); });
  for (const core::Image& image : images) CHECK(image == expected);
}

TEST_CASE("values that make no sense are refused by name") {
  const auto refused = [](const sim::Simulation& simulation, const std::string& part) {
    INFO(part);
    try {
      const World world(simulation);
      FAIL_CHECK("not refused");
    } catch (const core::BadInput& error) {
      CHECK(std::string(error.what()).find(part) != std::string::npos);
    }
  };
  const sim::Simulation good = test::still_simulation(SubjectKind::kGreyBall, 3, 8);
  sim::Simulation bad = good;
  bad.pixel_samples = 5;
  refused(bad, "pixel_samples");
  bad = good;
  bad.pixel_samples = 0;
  refused(bad, "pixel_samples");
  bad = good;
  bad.subject.size_m = -1;
  refused(bad, "size_m");
  bad = good;
  bad.subject.albedo = 1.5;
  refused(bad, "albedo");
  bad = good;
  bad.stage.simulation.led_radius_m = 0;
  refused(bad, "led_radius_m");
  bad = good;
  bad.stage.simulation.dead_lights = {3};
  refused(bad, "dead light 3");

  const World world(good);
  const capture::LightLevel level{3};
  CHECK_THROWS_AS(world.render(test::camera_of(world), {&level, 1}, 0), core::BadInput);
}

TEST_CASE("distortion and odd image sizes are rendered as the camera model says") {
  sim::Simulation simulation = test::still_simulation(SubjectKind::kChessboard, 0, 61);
  simulation.stage.light_positions = {{0, 0.4, 1.4}};
  core::CameraModel& camera = simulation.stage.cameras[0].model;
  camera.height = 47;
  camera.cy = 24.5;
  camera.k1 = 4;  // strong: the field of view is narrow
  camera.p1 = 0.05;
  const World world(simulation);
  const core::Image image = world.render(camera, test::all_lights(world), 0);
  REQUIRE(image.size() == core::ImageSize{47, 61, 3});
  const double side = 0.16 / 7;
  for (int row = -3; row <= 3; ++row) {
    for (int column = -4; column <= 4; ++column) {
      const std::optional<core::Pixel> p = camera.project({column * side, row * side, 0});
      REQUIRE(p);
      const int x = int(std::lround(p->x)), y = int(std::lround(p->y));
      if (x < 0 || x >= 61 || y < 0 || y >= 47) continue;
      const bool black = (row + column + 7) % 2 == 0;  // corners are black
      INFO("square " << column << " " << row);
      CHECK((image(y, x, 0) < 0.3F) == black);
    }
  }
}
