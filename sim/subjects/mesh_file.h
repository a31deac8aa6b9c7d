// Meshes from files.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "sim/render/subject.h"

namespace lightstage::sim {

// Loads PLY, OBJ, glTF, GLB, STL or OFF, all its meshes in one, in the file's axes: x right, y
// up, z towards the camera. Materials, buffers and textures that the file names must lie in its folder or below (core/foreign_path.h). Diffuse albedo is the base-colour texture where there is one, else the vertex
// colours, else the material's colour. 8-bit vertex colours and textures are taken as sRGB; those of glTF
// vertices are linear, as its specification says. The mesh is centred and scaled to `height` metres. `seed`
// chooses its gloss. Throws BadInput naming the file when it is missing or damaged, has no triangles, or has
// another hash than `hash` (not checked when empty).
std::unique_ptr<Subject> load_mesh(const std::string& path, const std::string& hash, double height, std::uint64_t seed);

}  // namespace lightstage::sim
