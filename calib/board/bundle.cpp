#include "calib/board/bundle.h"

#include <ceres/ceres.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "calib/robust/quantile.h"

namespace lightstage::calib {

namespace {

using core::Vec3;

constexpr double kExactPx = 1e-4;  // corners without any error still need a finite weight

std::vector<int> fixed_terms(DistortionTerms terms) {
  switch (terms) {
    case DistortionTerms::kNone:
      return {4, 5, 6, 7, 8};
    case DistortionTerms::kK1:
      return {5, 6, 7, 8};
    case DistortionTerms::kK1K2:
      return {6, 7, 8};
    case DistortionTerms::kK1K2P1P2:
      return {6};
    case DistortionTerms::kAll:
      return {};
  }
  return {};
}

constexpr std::array kLensNames{
    "focal length", "focal length", "principal point", "principal point", "k1", "k2", "k3", "p1", "p2"};

}  // namespace

CameraBundle::CameraBundle(const Board& board, DistortionTerms terms, std::size_t cameras, std::size_t instants)
    : lenses(cameras),
      rig_from_camera(cameras),
      rig_from_board(instants),
      sigma_px(cameras, 1.0),
      board_(board),
      fixed_(fixed_terms(terms)) {}

double CameraBundle::minimise(Loss loss, int most_iterations) {
  Steps steps(*this);
  ceres::Problem problem;
  build(problem, steps, loss);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.max_num_iterations = most_iterations;
  options.function_tolerance = 1e-12;
  options.parameter_tolerance = 1e-12;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  for (std::size_t c = 0; c < lenses.size(); ++c) rig_from_camera[c] = stepped(rig_from_camera[c], steps.cameras[c]);
  for (std::size_t i = 0; i < rig_from_board.size(); ++i) {
    rig_from_board[i] = stepped(rig_from_board[i], steps.boards[i]);
  }
  return summary.IsSolutionUsable() ? summary.final_cost : INFINITY;
}

std::optional<core::Pixel> CameraBundle::predicted(const View& view, const BoardCorner& corner) const {
  const Step none{};
  double pixel[2];
  const auto in_rig = out_of_frame(rig_from_board[view.instant], none.data(), board_.corner(corner.id));
  if (!project(lenses[view.camera].data(), into_frame(rig_from_camera[view.camera], none.data(), in_rig), pixel)) {
    return std::nullopt;
  }
  return core::Pixel{pixel[0], pixel[1]};
}

double CameraBundle::distance_px(const View& view, const BoardCorner& corner) const {
  const std::optional<core::Pixel> p = predicted(view, corner);
  return p ? std::hypot(p->x - corner.position.x, p->y - corner.position.y) : 1e6;
}

void CameraBundle::estimate_sigmas_by_median() {
  constexpr double kMedianOfRayleigh = 1.1774;
  for (std::size_t c = 0; c < lenses.size(); ++c) {
    std::vector<double> distances;
    for (const View& view : views) {
      if (view.camera != c) continue;
      for (const BoardCorner& corner : view.corners) distances.push_back(distance_px(view, corner));
    }
    sigma_px[c] = std::max(kExactPx, quantile(distances, 0.5) / kMedianOfRayleigh);
  }
}

void CameraBundle::estimate_sigmas() {
  std::size_t residuals = 0;
  for (const View& view : views) residuals += 2 * view.corners.size();
  const std::size_t unknowns = lenses.size() * (9 - fixed_.size()) + 6 * (lenses.size() - 1) + 6 * instants_used();
  const double free_share = residuals > unknowns ? 1 - double(unknowns) / double(residuals) : 0;
  for (std::size_t c = 0; c < lenses.size(); ++c) {
    double square = 0;
    std::size_t count = 0;
    for (const View& view : views) {
      if (view.camera != c) continue;
      for (const BoardCorner& corner : view.corners) {
        square += std::pow(distance_px(view, corner), 2);
        count += 2;
      }
    }
    if (count > 0 && free_share > 0) {
      sigma_px[c] = std::max(kExactPx, std::sqrt(square / (double(count) * free_share)));
    }
  }
}

CameraBundle::Errors CameraBundle::errors() {
  Steps steps(*this);
  ceres::Problem problem;
  build(problem, steps, Loss::kNone);
  struct Place {
    std::size_t camera;
    bool lens;
    int column;  // of its first unknown
  };
  ceres::Problem::EvaluateOptions options;
  std::vector<Place> places;
  int columns = 0;
  for (std::size_t c = 0; c < lenses.size(); ++c) {
    options.parameter_blocks.push_back(lenses[c].data());
    places.push_back({c, true, columns});
    columns += 9 - int(fixed_.size());
    if (c == 0) continue;
    options.parameter_blocks.push_back(steps.cameras[c].data());
    places.push_back({c, false, columns});
    columns += 6;
  }
  for (const std::size_t i : used_instants()) options.parameter_blocks.push_back(steps.boards[i].data());
  ceres::CRSMatrix jacobian;
  problem.Evaluate(options, nullptr, nullptr, nullptr, &jacobian);
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(jacobian.num_cols, jacobian.num_cols);
  for (int row = 0; row < jacobian.num_rows; ++row) {
    const auto first = std::size_t(jacobian.rows[std::size_t(row)]);
    const auto last = std::size_t(jacobian.rows[std::size_t(row) + 1]);
    for (std::size_t a = first; a < last; ++a) {
      for (std::size_t b = first; b < last; ++b) {
        normal(jacobian.cols[a], jacobian.cols[b]) += jacobian.values[a] * jacobian.values[b];
      }
    }
  }
  const Eigen::VectorXd scale = normal.diagonal().cwiseSqrt().cwiseMax(1e-300);
  const Eigen::MatrixXd scaled = scale.cwiseInverse().asDiagonal() * normal * scale.cwiseInverse().asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
  Errors result;
  result.sigma.resize(lenses.size());
  result.position_covariance.assign(lenses.size(), core::Mat3{{Vec3{}, Vec3{}, Vec3{}}});
  std::vector<int> free;
  for (int k = 0; k < 9; ++k) {
    if (std::find(fixed_.begin(), fixed_.end(), k) == fixed_.end()) free.push_back(k);
  }
  constexpr double kSingular = 1e-13, kTakesPart = 0.1;
  std::set<std::pair<std::size_t, std::string>> undetermined;
  for (int k = 0; k < columns && eigen.eigenvalues()(k) < kSingular * eigen.eigenvalues().maxCoeff(); ++k) {
    for (const Place& place : places) {
      for (std::size_t p = 0; p < (place.lens ? free.size() : 6); ++p) {
        if (std::abs(eigen.eigenvectors()(place.column + int(p), k)) < kTakesPart) continue;
        undetermined.emplace(place.camera, place.lens ? kLensNames[std::size_t(free[p])] : "pose");
      }
    }
  }
  result.undetermined.assign(undetermined.begin(), undetermined.end());
  const Eigen::VectorXd inverse = eigen.eigenvalues().cwiseMax(1e-300).cwiseInverse();
  const auto covariance = [&](int a, int b) {
    return (eigen.eigenvectors().row(a).cwiseProduct(eigen.eigenvectors().row(b))).dot(inverse.transpose()) /
           (scale(a) * scale(b));
  };
  const auto sigma = [&](int column) { return std::sqrt(covariance(column, column)); };
  for (const Place& place : places) {
    CameraErrors& e = result.sigma[place.camera];
    if (place.lens) {
      const std::array<double*, 9> slots{&e.fx, &e.fy, &e.cx, &e.cy, &e.k1, &e.k2, &e.k3, &e.p1, &e.p2};
      for (std::size_t p = 0; p < free.size(); ++p) *slots[std::size_t(free[p])] = sigma(place.column + int(p));
    } else {
      e.rotation = {sigma(place.column), sigma(place.column + 1), sigma(place.column + 2)};
      const int at = place.column + 3;
      e.position = {sigma(at), sigma(at + 1), sigma(at + 2)};
      for (int r = 0; r < 3; ++r) {
        result.position_covariance[place.camera].rows[std::size_t(r)] = {
            covariance(at + r, at), covariance(at + r, at + 1), covariance(at + r, at + 2)};
      }
    }
  }
  return result;
}

core::CameraModel CameraBundle::model(std::size_t camera, const RigCamera& size) const {
  const Lens& l = lenses[camera];
  core::CameraModel m;
  m.width = size.width, m.height = size.height;
  m.fx = l[0], m.fy = l[1], m.cx = l[2], m.cy = l[3];
  m.k1 = l[4], m.k2 = l[5], m.k3 = l[6], m.p1 = l[7], m.p2 = l[8];
  m.stage_from_camera = rig_from_camera[camera];
  return m;
}

std::vector<std::size_t> CameraBundle::used_instants() const {
  std::set<std::size_t> used;
  for (const View& view : views) used.insert(view.instant);
  return {used.begin(), used.end()};
}

void CameraBundle::build(ceres::Problem& problem, Steps& steps, Loss kind) {
  for (const View& view : views) {
    for (const BoardCorner& corner : view.corners) {
      ceres::LossFunction* loss = nullptr;
      if (kind == Loss::kHuber) loss = new ceres::HuberLoss(3);
      if (kind == Loss::kCauchy) loss = new ceres::CauchyLoss(2);
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<CornerCost, 2, 9, 6, 6>(
                                   new CornerCost{&rig_from_camera[view.camera], &rig_from_board[view.instant],
                                                  board_.corner(corner.id), corner.position, sigma_px[view.camera]}),
                               loss, lenses[view.camera].data(), steps.cameras[view.camera].data(),
                               steps.boards[view.instant].data());
    }
  }
  for (std::size_t c = 0; c < lenses.size(); ++c) {
    if (!problem.HasParameterBlock(lenses[c].data())) continue;
    if (!fixed_.empty()) problem.SetManifold(lenses[c].data(), new ceres::SubsetManifold(9, fixed_));
    // A focal length that the views do not determine would run away.
    for (int k = 0; k < 2; ++k) {
      problem.SetParameterLowerBound(lenses[c].data(), k, focal_from);
      problem.SetParameterUpperBound(lenses[c].data(), k, focal_to);
    }
    if (c == 0) problem.SetParameterBlockConstant(steps.cameras[c].data());
  }
}

}  // namespace lightstage::calib
