// Which pictures do not fit where they are.
#pragma once

#include <optional>
#include <vector>

#include "capture/light_check/picture_space.h"

namespace lightstage::capture {

// Finds one trouble after another, always the plainest one, and leaves the lights concerned out of what predicts the others.
class Judge {
 public:
  explicit Judge(const PictureSpace& space);

  // A picture like the dark ones.
  bool silent(std::size_t light) const;
  const std::vector<bool>& trusted() const { return trusted_; }
  // Takes the light out of all predictions.
  void distrust(std::size_t light);

  // How a picture fits in with a prediction: the sine of the angle between them, and a little more, so that pictures which
  // differ by less are equal.
  double misfit(std::size_t light, std::size_t place) const;
  // What is predicted for a place; without the light's own picture, should it be among the neighbours.
  const Combination& prediction(std::size_t place) const { return places_[place].all.sum; }

  enum class Kind { kPair, kElsewhere, kSame, kBoth };
  struct Suspicion {
    Kind kind = Kind::kPair;
    std::size_t light = 0, other = 0;
    double ratio = 0;  // of misfits: how much better it explains the picture
    double score = 0;  // logarithm of the ratio over that of its kind's bound; above 1: a finding
  };
  // The plainest trouble among trusted lights.
  std::optional<Suspicion> plainest();
  // The other place that suits the picture best, and by what ratio better than its own.
  Suspicion best_place(std::size_t light) const;

  // Whether the picture is the sum of what is predicted for both places rather than either one.
  bool shows_both_places(std::size_t light, std::size_t a, std::size_t b) const;

  // A light that nobody sees although its neighbours say that it should be seen.
  bool missing(std::size_t light) const;

 private:
  struct Prediction {
    Combination sum;
    double norm = 0;
  };
  struct Place {
    Prediction all;
    std::vector<std::pair<std::size_t, Prediction>> without;  // each of the neighbours
    double usual = 1;  // misfit around: the median of the neighbours', each predicted without this light
  };

  void predict_all();
  Prediction predicted(std::size_t place, std::size_t without) const;
  const Prediction& prediction(std::size_t place, std::size_t without) const;
  double misfit(std::size_t light, const Prediction& prediction) const;
  double misfit_to_picture(std::size_t light, std::size_t other) const;
  double misfit_with(std::size_t light, std::size_t other) const;
  void weigh(std::size_t light, std::size_t other, Suspicion& best) const;

  const PictureSpace& space_;
  double median_norm_ = 0;
  std::vector<bool> trusted_;
  std::vector<Place> places_;
  std::vector<double> best_gains_;  // of each light: how much better it fits in the place where it fits best
};

}  // namespace lightstage::capture
