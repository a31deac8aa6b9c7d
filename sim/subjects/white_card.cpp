#include "sim/subjects/white_card.h"

#include "sim/subjects/mesh_subject.h"

namespace lightstage::sim {
namespace {

class White : public Appearance {
 public:
  void apply(const MeshPoint&, SurfaceSample& sample) const override { sample.albedo = {0.9F, 0.9F, 0.9F}; }
};

}  // namespace

std::unique_ptr<Subject> make_white_card(double height) {
  const float half = float(height / 2);
  TriangleMesh card;
  card.positions = {{-half, -half, 0}, {half, -half, 0}, {half, half, 0}, {-half, half, 0}};
  card.normals.assign(4, {0, 0, 1});
  card.triangles = {{0, 1, 2}, {0, 2, 3}};
  return std::make_unique<MeshSubject>(std::move(card), std::make_unique<White>());
}

}  // namespace lightstage::sim
