// Meshes. The first byte says which format the rest is meant to be.
#include <array>

#include "fuzz/target.h"
#include "sim/subjects/mesh_file.h"

namespace lightstage::fuzz {

namespace {

const Registration kMesh({"mesh",
                          [](Bytes bytes) {
                            constexpr std::array kExtensions{".ply", ".obj", ".gltf", ".glb", ".stl", ".off"};
                            Input input(bytes);
                            const char* extension = kExtensions[input.byte() % kExtensions.size()];
                            const auto file = write(scratch() / "mesh" / (std::string("m") + extension), input.rest());
                            sim::load_mesh(file.string(), "", 0.25, 1);
                          },
                          1 << 16, 10});

}  // namespace

}  // namespace lightstage::fuzz
