// Much light from few directions: a map's patches as a tree of clusters, and for every price of a synthesis the cut through that tree that is cheapest.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/vec3.h"

namespace lightstage::relight {

// Light whose picture the captured lights may get wrong.
struct DoubtfulLight {
  core::Direction direction;
  core::Vec3 irradiance;  // may be negative, where there is less light than the smooth part of the map has
  double error = 0;       // expected root mean square of what is wrong with the picture of a unit light there
  bool between_lights =
      true;  // false in a hole of the stage, where errors of places far apart are alike and do not cancel
};

// Squares of root mean square errors, apart by where the light stands that causes them: between lights shadows and highlights are wrong, in holes of the stage
// whole sides of the subject, and the eye is not hurt alike. Also what either counts, where the two are to be weighed.
struct ByPlace {
  double between_lights = 0, in_holes = 0;
  double total() const { return between_lights + in_holes; }
  double weighed(const ByPlace& weights) const {
    return weights.between_lights * between_lights + weights.in_holes * in_holes;
  }
};
ByPlace operator+(const ByPlace& a, const ByPlace& b);
ByPlace operator-(const ByPlace& a, const ByPlace& b);
ByPlace operator*(double factor, const ByPlace& a);
ByPlace operator*(const ByPlace& a, const ByPlace& b);  // place by place
inline constexpr ByPlace kAlike{1, 1};

// A cluster that is carried by one synthesised picture.
struct Representative {
  core::Direction direction;  // mean over its light
  core::Vec3 irradiance;      // sum of its light
  ByPlace saved;              // by how much it lowers the variance
};

struct Cut {
  std::vector<Representative> representatives;  // those that save most come first
  // Expected square of the root mean square error that stays: of what is left out, and of lights that are not quite where their representative stands.
  ByPlace variance;
  std::vector<bool> represented;  // by light; the others are left out
};

// The error model. Errors of places a correlation length apart (the spacing of the lights) have nothing to do with each other, so their squares
// add up; nearer ones are alike and add up themselves. Three things can be done with a cluster of light h_b at places with errors d_b:
//   leave it out           variance |sum h_b|^2 d^2 where it is a piece, as wide as the correlation length; the sum of its halves' where it is wider; and its
//                          share of its piece's where it is a part of one, since the parts of a piece are wrong together
//   represent it by one    variance (sum |h_b| d_b)^2 min(1, 2 spread / (correlation length))^2, at the price of a synthesis
//   divide it              the sum of its halves'
// For a price the best choice is found from the leaves up in one pass (Chou, Lookabaugh and Gray 1989, "Optimal pruning with applications to tree-structured
// source coding and modeling"); the lower the price, the finer the cut.
class LightClusters {
 public:
  // O(n log n) for n lights, at least one. `spacing` of the captured lights, radians.
  LightClusters(std::span<const DoubtfulLight> lights, double spacing);

  // The best cut at this price of a synthesis, in units of weighed variance; O(n). A price of infinity leaves all out.
  Cut at_price(double price, const ByPlace& weights = kAlike) const;
  // Of those with at most so many representatives (a few less where a price skips a number), the best.
  Cut at_most(std::size_t representatives, const ByPlace& weights = kAlike) const;
  // The fewest representatives for a weighed variance of at most this; the finest cut where that is not to be had.
  Cut within(double variance, const ByPlace& weights = kAlike) const;

  // Lights that stand for what would be wrong were all left out: one for each piece as wide as the correlation length.
  struct Doubt {
    core::Direction direction;
    ByPlace variance;
  };
  std::vector<Doubt> doubts() const;

 private:
  struct Cluster {
    std::size_t left = 0, right = 0;  // 0: a leaf (the root, 0, is nobody's child)
    std::size_t first = 0, last = 0;  // its lights, in order_
    core::Direction centre;
    core::Vec3 irradiance;
    ByPlace left_out, represented;  // variances
    bool is_piece = false;          // its light is left out as one, its parent's is not
  };
  struct Choice {
    double cost = 0;
    char what = 0;
  };

  std::size_t build(std::size_t first, std::size_t last, std::span<const DoubtfulLight> lights,
                    std::optional<ByPlace> piece);
  std::vector<Choice> choices(double price, const ByPlace& weights) const;
  void collect(std::size_t cluster, const std::vector<Choice>& choices, Cut& cut) const;

  double correlation_length_;
  std::vector<std::size_t> order_;  // of the lights, so that every cluster's follow each other
  std::vector<Cluster> clusters_;   // parents before their children
};

}  // namespace lightstage::relight
