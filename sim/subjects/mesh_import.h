// What assimp makes of a mesh file, read where its crashes do no harm.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "sim/render/ray_scene.h"
#include "sim/subjects/texture.h"

namespace lightstage::sim {

// Vertices and triangles of all of a file's meshes, in the file's units.
struct ImportedMesh {
  std::vector<Vec3f> positions;  // finite
  std::vector<Vec3f> normals;    // unit
  // A vertex's: albedo (white under a texture), place in its texture, which texture (kNoTexture: none).
  std::vector<Vec3f> albedo;
  std::vector<TexturePoint> place;
  std::vector<std::int32_t> texture;
  std::vector<Triangle> triangles;  // of vertices that are there
  std::vector<TextureSource> textures;
};
inline constexpr std::int32_t kNoTexture = -1;

// Reads PLY, OBJ, glTF, GLB, STL and OFF, in a process of its own (core/child_process.h) that opens nothing outside the mesh's folder. Throws BadInput
// naming the file when it is none of these or damaged, or when it takes far more time or memory than a file of its size should.
ImportedMesh import_mesh(const std::filesystem::path& path);

}  // namespace lightstage::sim
