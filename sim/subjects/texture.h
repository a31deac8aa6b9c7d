// Pictures on meshes.
#pragma once

#include <filesystem>
#include <string>

#include "core/image.h"
#include "sim/render/vec3f.h"

struct aiScene;

namespace lightstage::sim {

// Texture coordinates: u to the right, v upwards, the picture repeats with period 1.
struct TexturePoint {
  float u = 0, v = 0;
  friend TexturePoint operator+(TexturePoint a, TexturePoint b) { return {a.u + b.u, a.v + b.v}; }
  friend TexturePoint operator*(TexturePoint a, float s) { return {a.u * s, a.v * s}; }
};

// Bilinear. Coordinates that are not finite give the first texel.
Vec3f look_up(const core::Image& texture, TexturePoint place);

// The texture that a mesh file names: inside the scene, or a file beside the mesh. Three channels, linear. Throws BadInput.
core::Image read_texture(const aiScene& scene, const std::filesystem::path& mesh_path, const std::string& name);

}  // namespace lightstage::sim
