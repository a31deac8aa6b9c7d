#include "model/classical/barycentric_weights.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>

#include "model/classical/ordered_sum.h"

namespace lightstage::model {

namespace {

constexpr double kHole = 3;            // spacings
constexpr double kWidest = 1.309;      // radians, 75 degrees: the ray meets no plane at a flatter angle than 15 degrees
constexpr double kGrowth = 0.5;        // of gaps in holes, with the distance from the nearest light
constexpr std::size_t kNeighbour = 2;  // the nearest may be a twin, as in stages whose lights stand in pairs

double angle(core::Vec3 a, core::Vec3 b) {
  return 2 * std::atan2(core::norm(a - b), core::norm(a + b));
}

// The median of the angles to the second nearest of the other points (to the only one, where there are two).
double spacing(std::span<const core::Vec3> points) {
  if (points.size() < 2) return kWidest;
  const std::size_t neighbour = std::min(kNeighbour, points.size() - 1);
  std::vector<double> spacings;
  for (const core::Vec3 point : points) {
    std::vector<double> chords;  // squared: in the order of the angles, and cheaper for thousands of lights
    for (const core::Vec3 other : points) chords.push_back(core::dot(point - other, point - other));
    std::nth_element(chords.begin(), chords.begin() + std::ptrdiff_t(neighbour), chords.end());
    spacings.push_back(2 * std::asin(std::min(1.0, std::sqrt(chords[neighbour]) / 2)));
  }
  const auto middle = spacings.begin() + std::ptrdiff_t(spacings.size() / 2);
  std::nth_element(spacings.begin(), middle, spacings.end());
  return *middle;
}

}  // namespace

BarycentricWeights::BarycentricWeights(std::span<const core::Direction> lights) : lights_(lights) {
  SphereTriangulation triangulation(lights_.points());
  fill_holes(triangulation);
  solve_holes(triangulation);
  for (const SphereTriangle& triangle : triangulation.triangles()) {
    const auto corner = [&](std::size_t i) { return triangulation.points()[triangle.corners[i % 3]]; };
    Triangle prepared{triangle.corners, {}};
    for (std::size_t i = 0; i < 3; ++i) {
      // Of the three differences of corners this one keeps small triangles from losing their digits: j x k = j x (k - j).
      prepared.coordinate_of[i] = core::cross(corner(i + 1), corner(i + 2) - corner(i + 1));
    }
    triangles_.push_back(prepared);
  }
  link_triangles();
}

// How much too wide a triangle's cap is: over 1 in a hole.
void BarycentricWeights::fill_holes(SphereTriangulation& triangulation) const {
  const double narrow = std::min(kWidest, kHole * spacing(lights_.points()));
  const auto excess = [&](const SphereTriangle& triangle) {
    double nearest_light = 4;
    if (triangle.cap_radius > narrow)
      for (const core::Vec3 light : lights_.points())
        nearest_light = std::min(nearest_light, angle(triangle.cap_centre, light));
    return triangle.cap_radius / std::clamp(kGrowth * nearest_light, narrow, kWidest);
  };
  for (;;) {
    const SphereTriangle* widest = nullptr;
    double widest_excess = 1;
    for (const SphereTriangle& triangle : triangulation.triangles()) {
      const double its = excess(triangle);
      if (its <= widest_excess) continue;
      widest_excess = its;
      widest = &triangle;
    }
    if (widest == nullptr) return;
    triangulation.add(core::Vec3(widest->cap_centre));
  }
}

void BarycentricWeights::solve_holes(const SphereTriangulation& triangulation) {
  const std::size_t lights = lights_.points().size();
  const int holes = int(triangulation.points().size() - lights);
  if (holes == 0) return;
  // Row by row: sum_j k_ij (value_i - value_j) = 0 over the neighbours j; the lights' values go to the right side.
  cv::Mat system = cv::Mat::zeros(holes, holes, CV_64F), right = cv::Mat::zeros(holes, int(lights), CV_64F);
  for (const SphereTriangle& triangle : triangulation.triangles()) {
    for (std::size_t side = 0; side < 3; ++side) {
      // Each edge is met twice, once in either direction.
      const std::size_t from = triangle.corners[side], to = triangle.corners[(side + 1) % 3];
      if (from < lights) continue;
      const int row = int(from - lights);
      const double k = 1 / angle(triangulation.points()[from], triangulation.points()[to]);
      system.at<double>(row, row) += k;
      if (to < lights) {
        right.at<double>(row, int(to)) += k;
      } else {
        system.at<double>(row, int(to - lights)) -= k;
      }
    }
  }
  cv::Mat solved;
  cv::solve(system, right, solved, cv::DECOMP_LU);
  for (int i = 0; i < holes; ++i) {
    std::vector<double> weights(solved.ptr<double>(i), solved.ptr<double>(i) + lights);
    for (double& weight : weights) weight = std::max(0.0, weight);
    hole_weights_.push_back(std::move(weights));
  }
}

void BarycentricWeights::link_triangles() {
  std::map<std::pair<std::size_t, std::size_t>, std::size_t> triangle_of_edge;
  const auto edge = [&](std::size_t t, std::size_t opposite) {
    const auto& corners = triangles_[t].corners;
    return std::pair(corners[(opposite + 1) % 3], corners[(opposite + 2) % 3]);
  };
  for (std::size_t t = 0; t < triangles_.size(); ++t)
    for (std::size_t i = 0; i < 3; ++i) triangle_of_edge[edge(t, i)] = t;
  for (std::size_t t = 0; t < triangles_.size(); ++t)
    for (std::size_t i = 0; i < 3; ++i) {
      const auto [from, to] = edge(t, i);
      triangles_[t].beyond[i] = triangle_of_edge.at({to, from});
    }
}

BarycentricWeights::Place BarycentricWeights::place_of(core::Vec3 query) const {
  Place place;
  double largest = -INFINITY;
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    std::array<double, 3> w{};
    for (std::size_t i = 0; i < 3; ++i) w[i] = core::dot(triangles_[t].coordinate_of[i], query);
    const double sum = w[0] + w[1] + w[2];
    if (!(sum > 0)) continue;
    const double smallest = std::min({w[0], w[1], w[2]}) / sum;
    if (smallest <= largest) continue;
    largest = smallest;
    place = {t, w};
  }
  double sum = 0;
  for (double& w : place.weights) sum += w = std::max(0.0, w);
  for (double& w : place.weights) w /= sum;
  return place;
}

BarycentricWeights::Place BarycentricWeights::place_near(std::size_t triangle, core::Vec3 query) const {
  // Walks in a Delaunay triangulation end (Devillers, Pion and Teillaud 2001, "Walking in a triangulation"); where rounding makes one go in circles, all
  // triangles are looked at.
  for (std::size_t steps = 0; steps < triangles_.size(); ++steps) {
    const Triangle& here = triangles_[triangle];
    std::array<double, 3> w{};
    for (std::size_t i = 0; i < 3; ++i) w[i] = core::dot(here.coordinate_of[i], query);
    const std::size_t least = std::size_t(std::min_element(w.begin(), w.end()) - w.begin());
    const double sum = w[0] + w[1] + w[2];
    if (w[least] >= 0 && sum > 0) return {triangle, {w[0] / sum, w[1] / sum, w[2] / sum}};
    triangle = here.beyond[least];
  }
  return place_of(query);
}

std::vector<double> BarycentricWeights::operator()(const core::Direction& query) const {
  const core::Vec3 q = query.vec();
  std::vector<double> per_point = lights_.one_hot_at(q);
  if (!per_point.empty()) return lights_.per_light(per_point);
  per_point.assign(lights_.points().size(), 0.0);
  const Place place = place_of(q);
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t corner = triangles_[place.triangle].corners[i];
    if (corner < per_point.size()) {
      per_point[corner] += place.weights[i];
    } else {
      const std::vector<double>& of_hole = hole_weights_[corner - per_point.size()];
      for (std::size_t light = 0; light < per_point.size(); ++light)
        per_point[light] += place.weights[i] * of_hole[light];
    }
  }
  return lights_.per_light(per_point);
}

std::vector<core::Vec3> BarycentricWeights::sum(std::span<const DistantLight> queries) const {
  const std::size_t points = lights_.points().size();
  std::vector<core::Vec3> per_corner =
      ordered_sum_of_parts(queries.size(), points + hole_weights_.size(),
                           [&](std::size_t first, std::size_t last, std::vector<core::Vec3>& sums) {
                             Place place;
                             for (std::size_t q = first; q < last; ++q) {
                               place = place_near(place.triangle, queries[q].direction.vec());
                               for (std::size_t i = 0; i < 3; ++i) {
                                 core::Vec3& sum = sums[triangles_[place.triangle].corners[i]];
                                 sum = sum + place.weights[i] * queries[q].irradiance;
                               }
                             }
                           });
  for (std::size_t hole = 0; hole < hole_weights_.size(); ++hole)
    for (std::size_t light = 0; light < points; ++light)
      per_corner[light] = per_corner[light] + hole_weights_[hole][light] * per_corner[points + hole];
  per_corner.resize(points);
  return lights_.per_light(per_corner);
}

}  // namespace lightstage::model
