// Pictures as vectors: everything that the light check asks of them are inner products.
#pragma once

#include <span>
#include <vector>

#include "capture/light_check.h"
#include "core/direction.h"

namespace lightstage::capture {

// A weighted sum of lights' pictures.
struct Combination {
  struct Term {
    std::size_t light = 0;
    double weight = 0;
  };
  std::vector<Term> terms;
};

// The pictures of all cameras as one vector a light, weighted by 1 / sqrt(mean picture + 0.3 of its mean): between radiance,
// in which highlights outweigh everything, and albedo-free ratios, in which rims do.
class PictureSpace {
 public:
  PictureSpace(std::span<const core::Direction> directions, std::span<const CameraPictures> cameras);

  std::size_t light_count() const { return directions_.size(); }
  double angle(std::size_t a, std::size_t b) const { return core::angle_radians(directions_[a], directions_[b]); }
  bool has_picture(std::size_t light) const { return has_picture_[light]; }

  // Root mean square of the dark pictures' norms, in which norms are given here, and the largest of them.
  double largest_dark_norm() const { return largest_dark_norm_; }

  double inner(std::size_t a, std::size_t b) const { return gram_[a * light_count() + b]; }
  double inner(const Combination& a, std::size_t b) const;
  double inner(const Combination& a, const Combination& b) const;
  double norm(std::size_t light) const;
  double norm(const Combination& sum) const;
  // Mean radiance of a picture over all cameras, for people.
  double mean(std::size_t light) const { return means_[light]; }
  double mean(const Combination& sum) const;

  // What the 6 nearest usable lights but `place` and `without` predict for a place: the constant term of a plane through
  // their pictures, fitted over the tangent plane. Empty where fewer than 4 are usable.
  Combination predict(std::size_t place, const std::vector<bool>& usable, std::size_t without) const;

 private:
  std::vector<core::Direction> directions_;
  std::vector<std::vector<std::size_t>> nearest_;  // of each light all others, nearest first
  std::vector<bool> has_picture_;
  std::vector<double> gram_, means_;
  double largest_dark_norm_ = 0;
};

}  // namespace lightstage::capture
