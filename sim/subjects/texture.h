// Pictures on meshes.
#pragma once

#include <filesystem>
#include <string>

#include "core/image.h"
#include "sim/render/vec3f.h"

namespace lightstage::sim {

// Texture coordinates: u to the right, v upwards, the picture repeats with period 1.
struct TexturePoint {
  float u = 0, v = 0;
  friend TexturePoint operator+(TexturePoint a, TexturePoint b) { return {a.u + b.u, a.v + b.v}; }
  friend TexturePoint operator*(TexturePoint a, float s) { return {a.u * s, a.v * s}; }
};

// Bilinear. Coordinates that are not finite give the first texel.
Vec3f look_up(const core::Image& texture, TexturePoint place);

// Where a mesh's texture is: a file that the mesh names, or a compressed picture in the mesh itself.
struct TextureSource {
  std::string file;
  std::string format, bytes;  // "png"
};

// Three channels, linear. Throws BadInput, also for a file outside the mesh's folder.
core::Image read_texture(const TextureSource& source, const std::filesystem::path& mesh_path);

}  // namespace lightstage::sim
