#include "db/check/misplaced.h"

#include <algorithm>
#include <cmath>

#include "core/display.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "db/check/neighbours.h"

namespace lightstage::db {
namespace {

constexpr std::size_t kLeastPictures = 16;
constexpr std::size_t kNeighbours = 4;
constexpr double kAloneRatio = 1.8;
constexpr double kPairRatio = 1.4;
// Added to distances between unit vectors: differences below it are noise, not evidence.
constexpr double kNoise = 0.05;

using Shading = std::vector<double>;

// To unit length; a picture without any shading stays zero, which resembles nothing.
void normalise(Shading& shading) {
  double squares = 0;
  for (const double v : shading) squares += v * v;
  if (squares < 1e-20) return;
  for (double& v : shading) v /= std::sqrt(squares);
}

Shading shading_of(const core::Image& thumbnail, const core::Image& mask) {
  const core::Image shown = core::display_encode(thumbnail);
  const auto inside = [&](std::size_t p) { return mask.empty() ? 1.0 : double(mask.values()[p]); };
  double sum = 0, area = 0;
  for (std::size_t p = 0; p < shown.values().size(); ++p) {
    sum += inside(p) * double(shown.values()[p]);
    area += inside(p);
  }
  const double mean = area > 0 ? sum / area : 0;
  Shading shading(shown.values().size());
  for (std::size_t p = 0; p < shading.size(); ++p) {
    shading[p] = std::sqrt(inside(p)) * (double(shown.values()[p]) - mean);
  }
  // What varies so little (a white card) shows the lens, how near the light is and noise, not where it is.
  constexpr double kEven = 0.1;
  double squares = 0;
  for (const double v : shading) squares += v * v;
  if (area > 0 && squares / area < kEven * kEven * mean * mean) std::fill(shading.begin(), shading.end(), 0.0);
  normalise(shading);
  return shading;
}

class Comparison {
 public:
  Comparison(std::span<const core::Direction> directions, std::vector<Shading> shadings)
      : shadings_(std::move(shadings)), misfit_(shadings_.size() * shadings_.size()) {
    const std::vector<bool> all(directions.size(), true);
    core::parallel_for(directions.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t place = first; place < last; ++place) {
        // One more than needed, for pictures that are themselves among the neighbours.
        compare_at(place, neighbours(directions, place, kNeighbours + 1, all));
      }
    });
  }

  // How badly the picture fits in with those around the place.
  double misfit(std::size_t picture, std::size_t place) const { return misfit_[place * shadings_.size() + picture]; }

 private:
  void compare_at(std::size_t place, std::span<const Neighbour> around) {
    const Shading usual = predict(around, shadings_.size());
    for (std::size_t picture = 0; picture < shadings_.size(); ++picture) {
      const bool is_neighbour =
          std::any_of(around.begin(), around.end() - 1, [&](const Neighbour& n) { return n.index == picture; });
      const double distance = is_neighbour ? distance_between(shadings_[picture], predict(around, picture))
                                           : distance_between(shadings_[picture], usual);
      misfit_[place * shadings_.size() + picture] = distance + kNoise;
    }
  }

  // From the nearest of those around, without the picture that is to be compared.
  Shading predict(std::span<const Neighbour> around, std::size_t without) const {
    Shading prediction(shadings_.front().size());
    std::size_t used = 0;
    for (const Neighbour& n : around) {
      if (n.index == without || used == kNeighbours) continue;
      for (std::size_t p = 0; p < prediction.size(); ++p) prediction[p] += n.weight * shadings_[n.index][p];
      ++used;
    }
    normalise(prediction);
    return prediction;
  }

  static double distance_between(const Shading& a, const Shading& b) {
    double squares = 0;
    bool any = false;
    for (std::size_t p = 0; p < a.size(); ++p) {
      squares += (a[p] - b[p]) * (a[p] - b[p]);
      any = any || a[p] != 0 || b[p] != 0;
    }
    return any ? std::sqrt(squares) : 1;  // two without shading are not alike
  }

  std::vector<Shading> shadings_;
  std::vector<double> misfit_;
};

}  // namespace

std::vector<Misplaced> find_misplaced(std::span<const core::Direction> directions,
                                      std::span<const core::Image> thumbnails, const core::Image& mask) {
  const std::size_t count = directions.size();
  if (count < kLeastPictures) return {};
  std::vector<Shading> shadings;
  for (const core::Image& image : thumbnails) shadings.push_back(shading_of(image, mask));
  const Comparison comparison(directions, std::move(shadings));
  const double far = std::max(core::radians_from_degrees(30), 2 * core::median_spacing_radians(directions));
  const auto are_far = [&](std::size_t a, std::size_t b) {
    return core::angle_radians(directions[a], directions[b]) > far;
  };
  const auto gain = [&](std::size_t picture, std::size_t place) {
    return comparison.misfit(picture, picture) / comparison.misfit(picture, place);
  };

  std::vector<std::optional<Misplaced>> found(count);
  // Pairs first: each explains the other, so that weaker evidence is enough. The best partner of each counts.
  std::vector<std::size_t> partner(count, count);
  std::vector<double> best(count, kPairRatio);
  for (std::size_t a = 0; a < count; ++a) {
    for (std::size_t b = 0; b < count; ++b) {
      if (!are_far(a, b) || gain(a, b) <= 1 || gain(b, a) <= 1) continue;
      const double both = std::sqrt(gain(a, b) * gain(b, a));
      if (both > best[a]) {
        best[a] = both;
        partner[a] = b;
      }
    }
  }
  for (std::size_t a = 0; a < count; ++a) {
    if (partner[a] < count && partner[partner[a]] == a) found[a] = Misplaced{a, partner[a], true};
  }
  for (std::size_t a = 0; a < count; ++a) {
    if (found[a]) continue;
    for (std::size_t b = 0; b < count; ++b) {
      if (!are_far(a, b) || gain(a, b) < (found[a] ? gain(a, found[a]->resembles) : kAloneRatio)) continue;
      found[a] = Misplaced{a, b, false};
    }
  }
  std::vector<Misplaced> misplaced;
  for (const auto& entry : found) {
    if (entry) misplaced.push_back(*entry);
  }
  return misplaced;
}

}  // namespace lightstage::db
