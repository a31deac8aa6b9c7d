#include "sim/subjects/mesh_import.h"

#include <assimp/DefaultIOSystem.h>
#include <assimp/material.h>
#include <assimp/mesh.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <algorithm>
#include <assimp/Importer.hpp>
#include <cctype>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <type_traits>

#include "core/child_process.h"
#include "core/display.h"
#include "core/error.h"
#include "core/foreign_path.h"
#include "core/printable.h"
#include "core/text.h"

namespace lightstage::sim {
namespace {

namespace fs = std::filesystem;

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
    const std::int32_t texture = part.HasTextureCoords(0) ? texture_of(part.mMaterialIndex) : kNoTexture;
    const Vec3f plain = material_colour(part.mMaterialIndex);
    for (unsigned i = 0; i < part.mNumVertices; ++i) {
      const aiVector3D p = part.mVertices[i], n = part.mNormals[i];
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
        fail("vertex " + std::to_string(i) + " is not finite");
      }
      mesh.positions.emplace_back(p.x, p.y, p.z);
      mesh.normals.push_back(normalised(Vec3f(n.x, n.y, n.z)));
      if (texture != kNoTexture) {
        mesh.albedo.emplace_back(1.0F, 1.0F, 1.0F);
        mesh.place.push_back({part.mTextureCoords[0][i].x, part.mTextureCoords[0][i].y});
      } else {
        mesh.albedo.push_back(part.HasVertexColors(0) ? vertex_colour(part.mColors[0][i]) : plain);
        mesh.place.push_back({});
      }
      mesh.texture.push_back(texture);
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

  ImportedMesh mesh;

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

  // The index in `mesh.textures` of a material's base colour.
  std::int32_t texture_of(unsigned material_index) {
    const auto known = texture_of_material_.find(material_index);
    if (known != texture_of_material_.end()) return known->second;
    std::int32_t result = kNoTexture;
    aiString name;
    const aiMaterial& material = *scene_.mMaterials[material_index];
    if (material.GetTexture(aiTextureType_BASE_COLOR, 0, &name) == AI_SUCCESS ||
        material.GetTexture(aiTextureType_DIFFUSE, 0, &name) == AI_SUCCESS) {
      result = std::int32_t(mesh.textures.size());
      mesh.textures.push_back(source_of(name.C_Str()));
    }
    texture_of_material_[material_index] = result;
    return result;
  }

  TextureSource source_of(const std::string& name) const {
    const aiTexture* embedded = scene_.GetEmbeddedTexture(name.c_str());
    if (embedded == nullptr) return {.file = name};
    if (embedded->mHeight != 0) fail("has a texture of bare texels, which none of the formats that are read can have");
    // Then mWidth counts the bytes of a compressed picture.
    return {.format = embedded->achFormatHint,
            .bytes = std::string(reinterpret_cast<const char*>(embedded->pcData), embedded->mWidth)};
  }

  const aiScene& scene_;
  const fs::path& path_;
  std::map<unsigned, std::int32_t> texture_of_material_;
};

ImportedMesh read_here(const fs::path& path) {
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
  return std::move(loader.mesh);
}

// What makes assimp's reader of PLY go on for ever or ask for all memory: a header without end, and elements that the file cannot hold.
void check_ply_header(const fs::path& path, std::uintmax_t file_bytes) {
  constexpr std::size_t kLongestHeader = 1 << 16;
  std::string header(kLongestHeader, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(header.data(), std::streamsize(header.size()));
  header.resize(std::size_t(file.gcount()));
  for (std::string_view line : core::split(header, '\n')) {
    line = core::trim(line);
    if (line == "end_header") return;
    if (!line.starts_with("element")) continue;
    const auto count = core::parse_integer(line.substr(line.find_last_of(" \t") + 1));
    // An element takes a byte at least.
    if (!count || *count < 0 || std::uintmax_t(*count) > file_bytes) {
      throw core::BadInput(path.string() + ": not a mesh that can be read: " + core::quoted(line) +
                           " in its header is more than the file holds, or no number");
    }
  }
  throw core::BadInput(path.string() + ": not a mesh that can be read: its header does not end");
}

// A mesh as bytes between two processes of one program.
class Writer {
 public:
  void put(const std::string& text) { put_all(text.data(), text.size(), 1); }
  template <class T>
  void put(const std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    put_all(values.data(), values.size(), sizeof(T));
  }
  void put(std::uint64_t count) { bytes.append(reinterpret_cast<const char*>(&count), sizeof count); }

  std::string bytes;

 private:
  void put_all(const void* values, std::size_t count, std::size_t size) {
    put(count);
    bytes.append(static_cast<const char*>(values), count * size);
  }
};

// Throws BadInput for bytes that do not fit together: they come from a process that a file may have taken over.
class Reader {
 public:
  Reader(std::string_view bytes, const fs::path& path) : bytes_(bytes), path_(path) {}

  void get(std::string& text) {
    const std::string_view all = take(count(1));
    text.assign(all.begin(), all.end());
  }
  template <class T>
  void get(std::vector<T>& values) {
    const std::size_t n = count(sizeof(T));
    values.resize(n);
    const std::string_view all = take(n * sizeof(T));
    if (n > 0) std::memcpy(values.data(), all.data(), all.size());
  }
  std::size_t count(std::size_t size) {
    std::uint64_t n = 0;
    const std::string_view all = take(sizeof n);
    std::memcpy(&n, all.data(), sizeof n);
    require(n <= bytes_.size() / size);
    return n;
  }
  void require(bool holds) const {
    if (!holds) throw core::BadInput(path_.string() + ": is damaged: its reader made nonsense of it");
  }

 private:
  std::string_view take(std::size_t n) {
    require(n <= bytes_.size());
    const std::string_view taken = bytes_.substr(0, n);
    bytes_.remove_prefix(n);
    return taken;
  }

  std::string_view bytes_;
  const fs::path& path_;
};

std::string to_bytes(const ImportedMesh& mesh) {
  Writer writer;
  writer.put(mesh.positions);
  writer.put(mesh.normals);
  writer.put(mesh.albedo);
  writer.put(mesh.place);
  writer.put(mesh.texture);
  writer.put(mesh.triangles);
  writer.put(mesh.textures.size());
  for (const TextureSource& texture : mesh.textures) {
    writer.put(texture.file);
    writer.put(texture.format);
    writer.put(texture.bytes);
  }
  return std::move(writer.bytes);
}

ImportedMesh from_bytes(std::string_view bytes, const fs::path& path) {
  Reader reader(bytes, path);
  ImportedMesh mesh;
  reader.get(mesh.positions);
  reader.get(mesh.normals);
  reader.get(mesh.albedo);
  reader.get(mesh.place);
  reader.get(mesh.texture);
  reader.get(mesh.triangles);
  mesh.textures.resize(reader.count(3 * sizeof(std::uint64_t)));
  for (TextureSource& texture : mesh.textures) {
    reader.get(texture.file);
    reader.get(texture.format);
    reader.get(texture.bytes);
  }
  const std::size_t vertices = mesh.positions.size();
  for (const std::size_t n : {mesh.normals.size(), mesh.albedo.size(), mesh.place.size(), mesh.texture.size()}) {
    reader.require(n == vertices);
  }
  for (const std::int32_t texture : mesh.texture) {
    reader.require(texture >= kNoTexture && texture < std::int32_t(mesh.textures.size()));
  }
  for (const Triangle& triangle : mesh.triangles) {
    for (const std::uint32_t corner : triangle) reader.require(corner < vertices);
  }
  for (const Vec3f p : mesh.positions) reader.require(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z));
  return mesh;
}

}  // namespace

ImportedMesh import_mesh(const fs::path& path) {
  // Each format is one more parser of strangers' bytes; these are the ones that scanners and modellers write.
  static const std::set<std::string> kFormats{".ply", ".obj", ".gltf", ".glb", ".stl", ".off"};
  std::string format = path.extension().string();
  std::transform(format.begin(), format.end(), format.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (!kFormats.contains(format)) throw core::BadInput(path.string() + ": not a PLY, OBJ, glTF, GLB, STL or OFF file");
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(path, error);
  if (error) throw core::BadInput(path.string() + ": cannot be read: " + error.message());
  // Far more than sound files were seen to take: two seconds and half a gigabyte for 100 MB of text.
  if (format == ".ply") check_ply_header(path, bytes);
  constexpr std::uintmax_t kBytesPerSecond = 200'000, kMemoryPerByte = 64;
  const core::ChildLimits limits{.processor_time = std::chrono::seconds(2 + bytes / kBytesPerSecond),
                                 .memory_bytes = (std::size_t(1) << 30) + bytes * kMemoryPerByte};
  return from_bytes(core::in_child(path, limits, [&] { return to_bytes(read_here(path)); }), path);
}

}  // namespace lightstage::sim
