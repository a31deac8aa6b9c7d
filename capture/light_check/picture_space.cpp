#include "capture/light_check/picture_space.h"

#include <algorithm>
#include <array>

#include "core/error.h"
#include "core/parallel.h"
#include "core/sphere.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kNeighbours = 6, kLeastNeighbours = 4;
// Of the mean: parts of the picture darker than this count as if they were so bright.
constexpr double kDarkShare = 0.3;
// In standard deviations of the dark pictures' pixels, likewise.
constexpr double kNoiseShare = 3;
// Share of the nearest light's angle that is added to all angles when they are weighted.
constexpr double kSoftening = 0.5;
// Pulls the slopes of the plane to 0, so that six lights on one side are not extrapolated without end.
constexpr double kRidge = 0.1;

core::ImageSize common_size(const CameraPictures& camera) {
  core::ImageSize size;
  const auto meet = [&](const core::Image& picture) {
    if (picture.empty()) return;
    if (size.height == 0) size = picture.size();
    if (picture.size() != size || size.channels != 1) {
      throw core::BadInput("light check: camera '" + camera.camera + "' has pictures of different sizes");
    }
  };
  for (const core::Image& picture : camera.of_light) meet(picture);
  for (const core::Image& picture : camera.dark) meet(picture);
  return size;
}

// Weights of the camera's pixels; see the class.
std::vector<double> pixel_weights(const CameraPictures& camera, std::size_t pixels) {
  std::vector<double> mean(pixels);
  double count = 0;
  for (const core::Image& picture : camera.of_light) {
    if (picture.empty()) continue;
    ++count;
    for (std::size_t p = 0; p < pixels; ++p) mean[p] += static_cast<double>(picture.values()[p]);
  }
  double total = 0, squares = 0;
  for (double& v : mean) total += v = std::max(0.0, v / std::max(count, 1.0));
  for (const core::Image& picture : camera.dark) {
    for (const float v : picture.values()) squares += static_cast<double>(v) * static_cast<double>(v);
  }
  const double all = static_cast<double>(pixels);
  const double noise = std::sqrt(squares / (all * std::max(1.0, static_cast<double>(camera.dark.size()) - 1)));
  const double least = kDarkShare * total / all + kNoiseShare * noise;
  for (double& v : mean) v = least > 0 ? 1 / std::sqrt(v + least) : 1;
  return mean;
}

// The first column of the inverse of a symmetric, positive definite 3x3 matrix.
std::array<double, 3> first_of_inverse(const core::Mat3& m) {
  const auto [a, b, c] = m.rows;
  const core::Vec3 cofactors = core::cross(b, c);
  const double determinant = core::dot(a, cofactors);
  return {cofactors.x / determinant, cofactors.y / determinant, cofactors.z / determinant};
}

}  // namespace

PictureSpace::PictureSpace(std::span<const core::Direction> directions, std::span<const CameraPictures> cameras)
    : directions_(directions.begin(), directions.end()), has_picture_(directions.size(), true) {
  const std::size_t n = light_count();
  for (const core::Direction& direction : directions_) {
    nearest_.push_back(core::nearest_indices(directions_, direction, n));
    std::erase(nearest_.back(), nearest_.size() - 1);
  }

  std::vector<std::vector<float>> vectors(n);
  std::vector<double> dark_squares;
  means_.resize(n);
  for (const CameraPictures& camera : cameras) {
    if (camera.of_light.size() != n) {
      throw core::BadInput("light check: camera '" + camera.camera + "' has pictures of " +
                           std::to_string(camera.of_light.size()) + " lights, the stage has " + std::to_string(n));
    }
    const std::size_t pixels = common_size(camera).value_count();
    const std::vector<double> weights = pixel_weights(camera, pixels);
    for (std::size_t i = 0; i < n; ++i) {
      const core::Image& picture = camera.of_light[i];
      if (picture.empty()) {
        has_picture_[i] = false;
        continue;
      }
      for (std::size_t p = 0; p < pixels; ++p) {
        const double v = static_cast<double>(picture.values()[p]);
        vectors[i].push_back(static_cast<float>(v * weights[p]));
        means_[i] += v / static_cast<double>(pixels * cameras.size());
      }
    }
    dark_squares.resize(std::max(dark_squares.size(), camera.dark.size()));
    for (std::size_t d = 0; d < camera.dark.size(); ++d) {
      for (std::size_t p = 0; p < pixels; ++p) {
        dark_squares[d] += std::pow(static_cast<double>(camera.dark[d].values()[p]) * weights[p], 2);
      }
    }
  }
  for (const double squares : dark_squares) largest_dark_norm_ = std::max(largest_dark_norm_, std::sqrt(squares));

  gram_.resize(n * n);
  core::parallel_for(n, 4, [&](std::size_t first, std::size_t last) {
    for (std::size_t a = first; a < last; ++a) {
      for (std::size_t b = 0; b <= a; ++b) {
        if (!has_picture_[a] || !has_picture_[b]) continue;
        double sum = 0;
        for (std::size_t p = 0; p < vectors[a].size(); ++p) {
          sum += static_cast<double>(vectors[a][p]) * static_cast<double>(vectors[b][p]);
        }
        gram_[a * n + b] = gram_[b * n + a] = sum;
      }
    }
  });
}

double PictureSpace::inner(const Combination& a, std::size_t b) const {
  double sum = 0;
  for (const Combination::Term& term : a.terms) sum += term.weight * inner(term.light, b);
  return sum;
}

double PictureSpace::inner(const Combination& a, const Combination& b) const {
  double sum = 0;
  for (const Combination::Term& term : b.terms) sum += term.weight * inner(a, term.light);
  return sum;
}

double PictureSpace::norm(std::size_t light) const {
  return std::sqrt(inner(light, light));
}

double PictureSpace::norm(const Combination& sum) const {
  return std::sqrt(std::max(0.0, inner(sum, sum)));
}

double PictureSpace::mean(const Combination& sum) const {
  double mean = 0;
  for (const Combination::Term& term : sum.terms) mean += term.weight * means_[term.light];
  return mean;
}

Combination PictureSpace::predict(std::size_t place, const std::vector<bool>& usable, std::size_t without) const {
  std::vector<std::size_t> around;
  for (const std::size_t light : nearest_[place]) {
    if (light == without || !usable[light]) continue;
    around.push_back(light);
    if (around.size() == kNeighbours) break;
  }
  Combination prediction;
  if (around.size() < kLeastNeighbours) return prediction;

  // Coordinates on the tangent plane: distances are angles to the place.
  const core::Vec3 z = directions_[place].vec();
  const core::Vec3 across = core::cross(std::abs(z.y) < 0.9 ? core::Vec3{0, 1, 0} : core::Vec3{1, 0, 0}, z);
  const core::Vec3 x = across / core::norm(across), y = core::cross(z, x);
  const double soft = kSoftening * angle(place, around.front()) + 1e-3;
  core::Mat3 normal{{core::Vec3{}, core::Vec3{}, core::Vec3{}}};
  std::vector<core::Vec3> rows;
  std::vector<double> weights;
  for (const std::size_t light : around) {
    const core::Vec3 d = directions_[light].vec();
    const double u = core::dot(d, x), v = core::dot(d, y), length = std::hypot(u, v), far = angle(place, light);
    const double scale = length > 0 ? far / length : 0;
    const core::Vec3 row{1, u * scale, v * scale};
    const double weight = 1 / (far * far + soft * soft);
    rows.push_back(row);
    weights.push_back(weight);
    normal.rows[0] = normal.rows[0] + weight * row.x * row;
    normal.rows[1] = normal.rows[1] + weight * row.y * row;
    normal.rows[2] = normal.rows[2] + weight * row.z * row;
  }
  const double ridge = kRidge * (normal.rows[1].y + normal.rows[2].z) / 2 + 1e-12;
  normal.rows[1].y += ridge;
  normal.rows[2].z += ridge;
  const auto [g0, g1, g2] = first_of_inverse(normal);
  for (std::size_t i = 0; i < around.size(); ++i) {
    prediction.terms.push_back({around[i], weights[i] * core::dot(core::Vec3{g0, g1, g2}, rows[i])});
  }
  return prediction;
}

}  // namespace lightstage::capture
