#include "sim/subjects/chessboard.h"

#include "sim/subjects/mesh_subject.h"

namespace lightstage::sim {
namespace {

// Printed paper: matt, and white where it is not black.
class Squares : public Appearance {
 public:
  explicit Squares(double side) : side_(float(side)) {}

  void apply(const MeshPoint&, SurfaceSample& sample) const override {
    const float column = sample.position.x / side_ + 0.5F * kChessboardColumns;
    const float row = sample.position.y / side_ + 0.5F * kChessboardRows;
    const bool inside = column >= 0 && column < kChessboardColumns && row >= 0 && row < kChessboardRows;
    const bool black = inside && (int(column) + int(row)) % 2 == 0;
    const float albedo = black ? 0.03F : 0.85F;
    sample.albedo = {albedo, albedo, albedo};
  }

 private:
  float side_;
};

}  // namespace

std::unique_ptr<Subject> make_chessboard(double height) {
  const double side = height / kChessboardRows;
  const float x = float(side * (0.5 * kChessboardColumns + 1)), y = float(side * (0.5 * kChessboardRows + 1));
  TriangleMesh board;
  board.positions = {{-x, -y, 0}, {x, -y, 0}, {x, y, 0}, {-x, y, 0}};
  board.normals.assign(4, {0, 0, 1});
  board.triangles = {{0, 1, 2}, {0, 2, 3}};
  return std::make_unique<MeshSubject>(std::move(board), std::make_unique<Squares>(side));
}

}  // namespace lightstage::sim
