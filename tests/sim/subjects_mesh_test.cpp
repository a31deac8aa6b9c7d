#include <catch2/catch.hpp>
#include <cstring>

#include "core/display.h"
#include "core/error.h"
#include "core/image_file.h"
#include "db/content_hash.h"
#include "support/support.h"
#include "world_scene.h"

using namespace lightstage;
namespace fs = std::filesystem;

namespace {

sim::Simulation of_mesh(const fs::path& path) {
  sim::Simulation simulation = test::still_simulation(sim::SubjectKind::kMesh, 0, 48);
  simulation.stage.light_positions = {{1.0, 0, 1.1}};
  simulation.subject.mesh_path = path.string();
  simulation.subject.size_m = 0.2;
  return simulation;
}

core::Image picture(const sim::Simulation& simulation) {
  const sim::World world(simulation);
  return world.render(test::camera_of(world), test::all_lights(world), 0);
}

void refused(const sim::Simulation& simulation, const std::string& part) {
  try {
    const sim::World world(simulation);
    FAIL_CHECK("not refused: " << part);
  } catch (const core::BadInput& error) {
    INFO(error.what());
    CHECK(std::string(error.what()).find(part) != std::string::npos);
    CHECK(std::string(error.what()).find(simulation.subject.mesh_path) != std::string::npos);
  }
}

// A square facing +z with one colour, 0 to 255.
std::string square_ply(const std::string& colour) {
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n";
  for (const char* corner : {"-1 -1 0 ", "1 -1 0 ", "1 1 0 ", "-1 1 0 "}) text += corner + colour + "\n";
  return text + "4 0 1 2 3\n";
}

// The same as glTF with its bytes in it, colours linear floats and a base colour if `texture` names one.
std::string square_gltf(float red, float green, float blue, const std::string& texture) {
  const std::vector<float> positions{-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
  std::vector<float> floats = positions;
  for (int i = 0; i < 4; ++i) floats.insert(floats.end(), {red, green, blue});
  floats.insert(floats.end(), {0, 1, 1, 1, 1, 0, 0, 0});  // texture coordinates; glTF counts v downwards
  std::string bytes(reinterpret_cast<const char*>(floats.data()), floats.size() * sizeof(float));
  for (const std::uint16_t i : {0, 1, 2, 0, 2, 3}) bytes.append(reinterpret_cast<const char*>(&i), 2);
  static const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string base64;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    unsigned group = 0;
    for (std::size_t k = 0; k < 3; ++k)
      group = group << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (int k = 3; k >= 0; --k) base64 += digits[group >> (6 * k) & 63u];
  }
  for (std::size_t pad = 0; pad < (3 - bytes.size() % 3) % 3; ++pad) base64[base64.size() - 1 - pad] = '=';
  const std::string material =
      texture.empty()
          ? ""
          : R"(,"images":[{"uri":")" + texture +
                R"("}],"textures":[{"source":0}],"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}])";
  const std::string colour = texture.empty() ? R"(,"COLOR_0":1)" : R"(,"TEXCOORD_0":2)";
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0)" +
         colour + R"(},"indices":3)" + (texture.empty() ? "" : R"(,"material":0)") +
         R"(}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-1,-1,0],"max":[1,1,0]},)"
         R"({"bufferView":1,"componentType":5126,"count":4,"type":"VEC3"},{"bufferView":2,"componentType":5126,"count":4,"type":"VEC2"},)"
         R"({"bufferView":3,"componentType":5123,"count":6,"type":"SCALAR"}],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},)"
         R"({"buffer":0,"byteOffset":48,"byteLength":48},{"buffer":0,"byteOffset":96,"byteLength":32},{"buffer":0,"byteOffset":128,"byteLength":12}],)"
         R"("buffers":[{"byteLength":140,"uri":"data:application/octet-stream;base64,)" +
         base64 + "\"}]" + material + "}";
}

// Diffuse albedo by ratios: the specular part is the same in all channels, so differences of channels are free of it.
double albedo_ratio(const core::Image& image, int x, int y, double white) {
  return (double(image(y, x, 0)) - double(image(y, x, 2))) / white;
}

}  // namespace

TEST_CASE("vertex colours of PLY files are sRGB") {
  const test::TemporaryFolder folder;
  test::write_text(folder / "red.ply", square_ply("188 100 0"));
  test::write_text(folder / "full.ply", square_ply("255 255 0"));
  const core::Image red = picture(of_mesh(folder / "red.ply")), full = picture(of_mesh(folder / "full.ply"));
  const double white = double(full(24, 24, 0)) - double(full(24, 24, 2));
  CHECK(white > 0.2);
  CHECK(albedo_ratio(red, 24, 24, white) == Approx(double(core::srgb_decode(188.0F / 255))).epsilon(1e-3));
  CHECK((double(red(24, 24, 1)) - double(red(24, 24, 2))) / white ==
        Approx(double(core::srgb_decode(100.0F / 255))).epsilon(1e-3));
}

TEST_CASE("vertex colours of glTF files are linear") {
  const test::TemporaryFolder folder;
  test::write_text(folder / "half.gltf", square_gltf(0.5F, 0.25F, 0, ""));
  test::write_text(folder / "full.ply", square_ply("255 255 0"));
  const core::Image half = picture(of_mesh(folder / "half.gltf")), full = picture(of_mesh(folder / "full.ply"));
  const double white = double(full(24, 24, 0)) - double(full(24, 24, 2));
  CHECK(albedo_ratio(half, 24, 24, white) == Approx(0.5).epsilon(1e-3));
}

TEST_CASE("textures of OBJ and glTF files lie the right way up") {
  const test::TemporaryFolder folder;
  core::Image texture(8, 8, 3);
  for (int y = 0; y < 8; ++y) {
    for (int x = 0; x < 8; ++x) {
      texture(y, x, 0) = y < 4 ? 0.6F : 0;  // red above
      texture(y, x, 1) = x < 4 ? 0.6F : 0;  // green to the left
    }
  }
  core::write_image(folder / "paint.png", texture);
  test::write_text(folder / "square.mtl", "newmtl paint\nmap_Kd paint.png\n");
  test::write_text(
      folder / "square.obj",
      "mtllib square.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl paint\n"
      "f 1/1 2/2 3/3 4/4\n");
  test::write_text(folder / "square.gltf", square_gltf(1, 1, 1, "paint.png"));
  for (const char* name : {"square.obj", "square.gltf"}) {
    INFO(name);
    const core::Image image = picture(of_mesh(folder / name));
    // The square spans 32 pixels about the middle.
    const auto red = [&](int x, int y) { return image(y, x, 0) - image(y, x, 2); };
    const auto green = [&](int x, int y) { return image(y, x, 1) - image(y, x, 2); };
    CHECK(red(18, 16) > 0.1F);
    CHECK(red(30, 16) > 0.1F);
    CHECK(red(18, 32) < 1e-3F);
    CHECK(green(16, 18) > 0.1F);
    CHECK(green(16, 30) > 0.1F);
    CHECK(green(32, 18) < 1e-3F);
  }
}

TEST_CASE("a mesh is centred and scaled to its height") {
  const test::TemporaryFolder folder;
  test::write_text(folder / "far.obj", "v 100 50 7\nv 102 50 7\nv 102 54 7\nv 100 54 7\nf 1 2 3 4\n");
  const sim::World world(of_mesh(folder / "far.obj"));
  const core::CameraModel& camera = test::camera_of(world);
  double area = 0;
  const core::Image covered = world.coverage(camera, 0);
  for (const float v : covered.values()) area += double(v);
  const double height = camera.fy * 0.2 / test::kCameraDistance;
  CHECK(area == Approx(height * height / 2).epsilon(0.02));
  CHECK(covered(24, 24) == Approx(1));
}

TEST_CASE("a mesh that has changed or is not right is refused with its path") {
  const test::TemporaryFolder folder;
  refused(of_mesh(folder / "nowhere.ply"), "no such mesh file");
  refused(of_mesh(folder.path()), "no such mesh file");

  const fs::path path = folder / "square.ply";
  test::write_text(path, square_ply("10 20 30"));
  sim::Simulation recorded = of_mesh(path);
  recorded.subject.mesh_hash = db::hash_file(path).hex();
  CHECK_NOTHROW(sim::World(recorded));
  test::write_text(path, square_ply("10 20 31"));
  refused(recorded, "has changed");

  test::write_text(folder / "noise.ply", "this is not a mesh");
  refused(of_mesh(folder / "noise.ply"), "not a mesh");
  const std::string whole = square_ply("10 20 30");
  test::write_text(folder / "cut.ply", whole.substr(0, whole.size() - 40));
  refused(of_mesh(folder / "cut.ply"), "cut.ply");
  test::write_text(folder / "points.obj", "v 0 0 0\nv 1 1 1\nv 2 2 2\np 1 2 3\n");
  refused(of_mesh(folder / "points.obj"), "points.obj");
  test::write_text(folder / "dot.obj", "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n");
  refused(of_mesh(folder / "dot.obj"), "dot.obj");
  test::write_text(folder / "bare.obj",
                   "mtllib bare.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n");
  test::write_text(folder / "bare.mtl", "newmtl m\nmap_Kd missing.png\n");
  try {
    const sim::World world(of_mesh(folder / "bare.obj"));
    FAIL_CHECK("a missing texture was not noticed");
  } catch (const core::BadInput& error) {
    CHECK(std::string(error.what()).find("missing.png") != std::string::npos);
  }
}

TEST_CASE("every real head mesh loads and is lit") {
  const fs::path heads = test::real_data("heads");
  if (heads.empty()) SKIP_TEST("no real data");
  int loaded = 0;
  for (const fs::directory_entry& entry : fs::directory_iterator(heads)) {
    if (entry.path().extension() != ".ply") continue;
    INFO(entry.path().string());
    sim::Simulation simulation = of_mesh(entry.path());
    simulation.subject.size_m = 0;
    const core::Image image = picture(simulation);
    double sum = 0;
    for (const float v : image.values()) {
      REQUIRE(std::isfinite(v));
      sum += double(v);
    }
    CHECK(sum > 10);
    ++loaded;
  }
  CHECK(loaded == 20);
}
