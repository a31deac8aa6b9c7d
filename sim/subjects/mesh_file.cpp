#include "sim/subjects/mesh_file.h"

#include <filesystem>

#include "core/error.h"
#include "db/content_hash.h"
#include "sim/scene/random.h"
#include "sim/subjects/mesh_import.h"
#include "sim/subjects/mesh_subject.h"
#include "sim/subjects/texture.h"

namespace lightstage::sim {
namespace {

namespace fs = std::filesystem;

struct MeshColours {
  std::vector<Vec3f> albedo;          // one a vertex; white under a texture
  std::vector<TexturePoint> place;    // one a vertex
  std::vector<std::int32_t> texture;  // one a vertex: index in textures, or kNoTexture
  std::vector<core::Image> textures;
};

class FileAppearance : public Appearance {
 public:
  FileAppearance(MeshColours colours, std::uint64_t seed)
      : colours_(std::move(colours)),
        alpha_(float(0.18 + 0.22 * uniform(mix(seed), 0))),
        f0_(float(0.028 + 0.017 * uniform(mix(seed), 1))) {}

  void apply(const MeshPoint& point, SurfaceSample& sample) const override {
    sample.albedo = point.interpolate(colours_.albedo);
    const int texture = colours_.texture[point.corners[0]];
    if (texture != kNoTexture) {
      sample.albedo =
          sample.albedo * look_up(colours_.textures[std::size_t(texture)], point.interpolate(colours_.place));
    }
    sample.alpha = alpha_;
    sample.f0 = f0_;
  }

 private:
  MeshColours colours_;
  float alpha_, f0_;
};

void check_file(const fs::path& path, const std::string& hash) {
  if (path.empty()) throw core::BadInput("the subject is a mesh, but no mesh file is named");
  if (!fs::is_regular_file(path)) throw core::BadInput(path.string() + ": there is no such mesh file");
  if (hash.empty()) return;
  if (db::hash_file(path) != db::ContentHash::from_hex(hash)) {
    throw core::BadInput(path.string() + ": the mesh has changed since the scan was captured (its hash was " + hash +
                         "); put the original file back");
  }
}

}  // namespace

std::unique_ptr<Subject> load_mesh(const std::string& path_text, const std::string& hash, double height,
                                   std::uint64_t seed) {
  const fs::path path = path_text;
  check_file(path, hash);
  ImportedMesh imported = import_mesh(path);
  if (imported.triangles.empty()) throw core::BadInput(path.string() + ": the mesh has no triangles");
  MeshColours colours{std::move(imported.albedo), std::move(imported.place), std::move(imported.texture), {}};
  for (const TextureSource& texture : imported.textures) colours.textures.push_back(read_texture(texture, path));
  TriangleMesh mesh{std::move(imported.positions), std::move(imported.normals), std::move(imported.triangles)};
  centre_and_scale(mesh, height, path.string());
  return std::make_unique<MeshSubject>(std::move(mesh), std::make_unique<FileAppearance>(std::move(colours), seed));
}

}  // namespace lightstage::sim
