#include "sim/subjects/mesh_file.h"

#include <assimp/material.h>
#include <assimp/mesh.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/DefaultIOSystem.h>
#include <algorithm>
#include <assimp/Importer.hpp>
#include <cctype>
#include <filesystem>
#include <set>

#include "core/display.h"
#include "core/error.h"
#include "core/foreign_path.h"
#include "db/content_hash.h"
#include "sim/scene/random.h"
#include "sim/subjects/mesh_subject.h"
#include "sim/subjects/texture.h"

namespace lightstage::sim {
namespace {

namespace fs = std::filesystem;

constexpr int kNoTexture = -1;

struct MeshColours {
  std::vector<Vec3f> albedo;        // one a vertex; white under a texture
  std::vector<TexturePoint> place;  // one a vertex
  std::vector<int> texture;         // one a vertex: index in textures, or kNoTexture
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

bool is_gltf(const fs::path& path) {
  return path.extension() == ".gltf" || path.extension() == ".glb";
}

// Opens the mesh and what it names, below its folder.
class FilesBeside : public Assimp::DefaultIOSystem {
 public:
  explicit FilesBeside(const fs::path& mesh) : mesh_(mesh), folder_(mesh.parent_path()) {}

  bool Exists(const char* file) const override { return may_read(file) && DefaultIOSystem::Exists(file); }
  Assimp::IOStream* Open(const char* file, const char* mode) override {
    return may_read(file) && *mode == 'r' ? DefaultIOSystem::Open(file, mode) : nullptr;
  }

 private:
  // Importers put the mesh's folder before the name; some ask for the bare name too.
  bool may_read(const fs::path& file) const {
    std::error_code error;
    if (!fs::is_regular_file(file, error)) return false;
    if (file == mesh_) return true;
    const fs::path name = file.lexically_relative(folder_.empty() ? fs::path(".") : folder_);
    return !core::objection_to_name(folder_, name.native()) && fs::equivalent(file, folder_ / name, error);
  }

  fs::path mesh_, folder_;
};

class Loader {
 public:
  Loader(const aiScene& scene, const fs::path& path) : scene_(scene), path_(path) {}

  void add(const aiMesh& part) {
    const auto base = std::uint32_t(mesh.positions.size());
    const int texture = part.HasTextureCoords(0) ? texture_of(part.mMaterialIndex) : kNoTexture;
    const Vec3f plain = material_colour(part.mMaterialIndex);
    for (unsigned i = 0; i < part.mNumVertices; ++i) {
      const aiVector3D p = part.mVertices[i], n = part.mNormals[i];
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
        fail("vertex " + std::to_string(i) + " is not finite");
      }
      mesh.positions.emplace_back(p.x, p.y, p.z);
      mesh.normals.push_back(normalised(Vec3f(n.x, n.y, n.z)));
      if (texture != kNoTexture) {
        colours.albedo.emplace_back(1.0F, 1.0F, 1.0F);
        colours.place.push_back({part.mTextureCoords[0][i].x, part.mTextureCoords[0][i].y});
      } else {
        colours.albedo.push_back(part.HasVertexColors(0) ? vertex_colour(part.mColors[0][i]) : plain);
        colours.place.push_back({});
      }
      colours.texture.push_back(texture);
    }
    for (unsigned i = 0; i < part.mNumFaces; ++i) {
      const aiFace& face = part.mFaces[i];
      if (face.mNumIndices != 3) continue;  // points and lines
      Triangle triangle;
      for (std::size_t k = 0; k < 3; ++k) {
        if (face.mIndices[k] >= part.mNumVertices)
          fail("triangle " + std::to_string(i) + " names a vertex that does not exist");
        triangle[k] = base + face.mIndices[k];
      }
      mesh.triangles.push_back(triangle);
    }
  }

  [[noreturn]] void fail(const std::string& problem) const { throw core::BadInput(path_.string() + ": " + problem); }

  TriangleMesh mesh;
  MeshColours colours;

 private:
  Vec3f vertex_colour(aiColor4D c) const {
    const auto linear = [&](float v) {
      v = std::isfinite(v) ? std::clamp(v, 0.0F, 1.0F) : 0;
      return is_gltf(path_) ? v : core::srgb_decode(v);
    };
    return {linear(c.r), linear(c.g), linear(c.b)};
  }

  // Of what has neither texture nor vertex colours; mid-grey where the file says nothing.
  Vec3f material_colour(unsigned material_index) const {
    aiColor4D colour(0.5F, 0.5F, 0.5F, 1);
    aiGetMaterialColor(scene_.mMaterials[material_index], AI_MATKEY_COLOR_DIFFUSE, &colour);
    return {std::clamp(colour.r, 0.0F, 1.0F), std::clamp(colour.g, 0.0F, 1.0F), std::clamp(colour.b, 0.0F, 1.0F)};
  }

  // The index in `colours.textures` of a material's base colour, read at its first use.
  int texture_of(unsigned material_index) {
    const auto known = texture_of_material_.find(material_index);
    if (known != texture_of_material_.end()) return known->second;
    int result = kNoTexture;
    aiString name;
    const aiMaterial& material = *scene_.mMaterials[material_index];
    if (material.GetTexture(aiTextureType_BASE_COLOR, 0, &name) == AI_SUCCESS ||
        material.GetTexture(aiTextureType_DIFFUSE, 0, &name) == AI_SUCCESS) {
      result = int(colours.textures.size());
      colours.textures.push_back(read_texture(scene_, path_, name.C_Str()));
    }
    texture_of_material_[material_index] = result;
    return result;
  }

  const aiScene& scene_;
  const fs::path& path_;
  std::map<unsigned, int> texture_of_material_;
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
  // Each format is one more parser of strangers' bytes; these are the ones that scanners and modellers write.
  static const std::set<std::string> kFormats{".ply", ".obj", ".gltf", ".glb", ".stl", ".off"};
  std::string format = path.extension().string();
  std::transform(format.begin(), format.end(), format.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (!kFormats.contains(format)) throw core::BadInput(path.string() + ": not a PLY, OBJ, glTF, GLB, STL or OFF file");
  Assimp::Importer importer;
  importer.SetIOHandler(new FilesBeside(path));  // which the importer owns
  const aiScene* scene = importer.ReadFile(
      path.string(), aiProcess_Triangulate | aiProcess_JoinIdenticalVertices | aiProcess_GenSmoothNormals |
                         aiProcess_PreTransformVertices | aiProcess_SortByPType | aiProcess_FindInvalidData |
                         aiProcess_ValidateDataStructure);
  if (scene == nullptr)
    throw core::BadInput(path.string() + ": not a mesh that can be read: " + importer.GetErrorString());
  Loader loader(*scene, path);
  for (unsigned i = 0; i < scene->mNumMeshes; ++i) {
    const aiMesh& part = *scene->mMeshes[i];
    if ((part.mPrimitiveTypes & aiPrimitiveType_TRIANGLE) != 0 && part.HasNormals()) loader.add(part);
  }
  if (loader.mesh.triangles.empty()) loader.fail("the mesh has no triangles");
  centre_and_scale(loader.mesh, height, path.string());
  return std::make_unique<MeshSubject>(std::move(loader.mesh),
                                       std::make_unique<FileAppearance>(std::move(loader.colours), seed));
}

}  // namespace lightstage::sim
