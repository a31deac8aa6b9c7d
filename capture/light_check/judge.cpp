#include "capture/light_check/judge.h"

#include <algorithm>

namespace lightstage::capture {

namespace {

// Ratios of misfits from which on a picture counts as another light's. On simulated stages without fault (a head and a ball, 40 to
// 150 lights, one camera and two) pairs reach 1.5 and sums 1.6, both at grazing light.
constexpr double kPairRatio = 1.8, kAloneRatio = 2, kSameRatio = 3.5, kDoubleRatio = 1.75;
// Each light of a pair must fit better in the other's place, if only a little.
constexpr double kLeastOfPair = 1.1;
// And in no other place so much better.
constexpr double kMutual = 1.5;
// A picture is taken for a sum where that explains it so much better than a single place.
constexpr double kSimpler = 1.2;
// And worse in its own than neighbours do in theirs: at grazing light nothing fits.
constexpr double kUnusual = 1.15;
// Pictures of one light at different times differ by so much, as the subject moves.
constexpr double kEqual = 0.02;
// What a light may give, of what is predicted, with another one beside it.
constexpr double kLeastLevel = 0.5, kMostLevel = 1.8;

// In norms of the largest dark picture: up to which a picture is one, from which on a prediction is none.
constexpr double kSilent = 1.5, kSeen = 6;
// Share of the median picture's norm from which on neighbours predict light. On the dark side of a ball, where pictures end
// soundly, they predict 0.08 at most.
constexpr double kBright = 0.2;
// Misfit of the neighbours up to which they say what should be seen between them. Behind a head each of them shows another rim,
// predicted by none of the others: from 0.86 on.
constexpr double kPredictable = 0.72;

double sine(double inner, double norms) {
  const double cosine = norms > 0 ? std::clamp(inner / norms, 0.0, 1.0) : 0;
  return std::sqrt(1 - cosine * cosine);
}

}  // namespace

Judge::Judge(const PictureSpace& space) : space_(space), places_(space.light_count()) {
  std::vector<double> norms;
  for (std::size_t i = 0; i < space.light_count(); ++i) {
    trusted_.push_back(space.has_picture(i));
    norms.push_back(space.norm(i));
  }
  const auto middle = norms.begin() + std::ssize(norms) / 2;
  std::nth_element(norms.begin(), middle, norms.end());
  median_norm_ = *middle;
  predict_all();
}

void Judge::distrust(std::size_t light) {
  trusted_[light] = false;
  predict_all();
}

Judge::Prediction Judge::predicted(std::size_t place, std::size_t without) const {
  Prediction p{space_.predict(place, trusted_, without)};
  p.norm = space_.norm(p.sum);
  return p;
}

void Judge::predict_all() {
  const std::size_t nobody = space_.light_count();
  for (std::size_t place = 0; place < places_.size(); ++place) {
    Place& p = places_[place];
    p.all = predicted(place, nobody);
    p.without.clear();
    for (const Combination::Term& term : p.all.sum.terms) {
      p.without.emplace_back(term.light, predicted(place, term.light));
    }
  }
  for (std::size_t place = 0; place < places_.size(); ++place) {
    std::vector<double> around;
    for (const Combination::Term& term : places_[place].all.sum.terms) {
      around.push_back(misfit(term.light, prediction(term.light, place)));
    }
    std::sort(around.begin(), around.end());
    places_[place].usual = around.empty() ? 1 : around[around.size() / 2];
  }
}

const Judge::Prediction& Judge::prediction(std::size_t place, std::size_t without) const {
  for (const auto& [light, prediction] : places_[place].without) {
    if (light == without) return prediction;
  }
  return places_[place].all;
}

double Judge::median_misfit() const {
  std::vector<double> misfits;
  for (std::size_t light = 0; light < space_.light_count(); ++light) {
    if (judged(light)) misfits.push_back(misfit(light, light));
  }
  if (misfits.empty()) return 0;
  const auto middle = misfits.begin() + std::ssize(misfits) / 2;
  std::nth_element(misfits.begin(), middle, misfits.end());
  return *middle;
}

bool Judge::judged(std::size_t light) const {
  return trusted_[light] && !silent(light) && !places_[light].all.sum.terms.empty();
}

bool Judge::silent(std::size_t light) const {
  return space_.norm(light) <= kSilent * space_.largest_dark_norm();
}

double Judge::misfit(std::size_t light, const Prediction& prediction) const {
  return sine(space_.inner(prediction.sum, light), space_.norm(light) * prediction.norm) + kEqual;
}

double Judge::misfit(std::size_t light, std::size_t place) const {
  return misfit(light, prediction(place, light));
}

double Judge::misfit_to_picture(std::size_t light, std::size_t other) const {
  return sine(space_.inner(light, other), space_.norm(light) * space_.norm(other)) + kEqual;
}

// What is left of the picture when the other light's (none, where there is no such light) and as much of the prediction as
// may be are taken away, over the norm of the prediction.
double Judge::misfit_with(std::size_t light, std::size_t other) const {
  const Prediction& expected = places_[light].all;
  const double square = expected.norm * expected.norm;
  if (square <= 0) return 1;
  double with_expected = space_.inner(expected.sum, light), rest = space_.inner(light, light);
  if (other < space_.light_count()) {
    with_expected -= space_.inner(expected.sum, other);
    rest += space_.inner(other, other) - 2 * space_.inner(light, other);
  }
  const double level = std::clamp(with_expected / square, kLeastLevel, kMostLevel);
  return std::sqrt(std::max(0.0, rest + level * level * square - 2 * level * with_expected) / square) + kEqual;
}

void Judge::weigh(std::size_t light, std::size_t other, Suspicion& best) const {
  const double own = misfit(light, light), unusual = own / places_[light].usual;
  const auto offer = [&](Kind kind, double ratio, double bound, double unlike_its_neighbours) {
    if (unlike_its_neighbours < kUnusual) return;
    const double score = std::log(std::max(ratio, 1e-9)) / std::log(bound);
    if (score > best.score) best = {kind, light, other, ratio, score};
  };
  const double there = misfit(light, other), own_of_other = misfit(other, other);
  const bool comparable = trusted_[other] && !silent(other);
  const double same = comparable ? own / misfit_to_picture(light, other) : 0;
  if (same > kSameRatio) {
    // At fault is the one that fits worse in its own place. Scored as kElsewhere is, with which it competes.
    if (own_of_other < own) offer(Kind::kSame, same, kAloneRatio, unusual);
    return;
  }
  const bool predictable = places_[light].usual < kPredictable;
  if (predictable) offer(Kind::kElsewhere, own / there, kAloneRatio, unusual);
  if (!comparable) return;
  if (other < light) {
    const double first = misfit(light, prediction(light, other)) / there;
    const double second = misfit(other, prediction(other, light)) / misfit(other, light);
    const bool mutual = first * kMutual > best_gains_[light] && second * kMutual > best_gains_[other];
    if (mutual && std::min(first, second) > kLeastOfPair) {
      offer(Kind::kPair, std::sqrt(first * second), kPairRatio,
            std::sqrt(unusual * own_of_other / places_[other].usual));
    }
  }
  if (!predictable) return;
  // The sum must explain the picture better than any single place does.
  const double left = misfit_with(light, other);
  if (left * places_[light].all.norm * kSimpler < own / best_gains_[light] * space_.norm(light)) {
    offer(Kind::kBoth, misfit_with(light, space_.light_count()) / left, kDoubleRatio, unusual);
  }
}

std::optional<Judge::Suspicion> Judge::plainest() {
  best_gains_.assign(space_.light_count(), 0);
  for (std::size_t light = 0; light < space_.light_count(); ++light) {
    if (judged(light)) best_gains_[light] = best_place(light).ratio;
  }
  Suspicion best;
  for (std::size_t light = 0; light < space_.light_count(); ++light) {
    if (!judged(light)) continue;
    for (std::size_t other = 0; other < space_.light_count(); ++other) {
      if (other != light) weigh(light, other, best);
    }
  }
  if (best.score < 1) return std::nullopt;
  return best;
}

Judge::Suspicion Judge::best_place(std::size_t light) const {
  Suspicion best{Kind::kElsewhere, light, light, 0, 0};
  const double own = misfit(light, light);
  for (std::size_t place = 0; place < space_.light_count(); ++place) {
    if (place == light) continue;
    const double ratio = own / misfit(light, place);
    if (ratio > best.ratio) best = {Kind::kElsewhere, light, place, ratio, std::log(ratio) / std::log(kAloneRatio)};
  }
  return best;
}

bool Judge::shows_both_places(std::size_t light, std::size_t a, std::size_t b) const {
  const Prediction &first = prediction(a, b), &second = prediction(b, a);
  Prediction both = first;
  both.sum.terms.insert(both.sum.terms.end(), second.sum.terms.begin(), second.sum.terms.end());
  both.norm = space_.norm(both.sum);
  return misfit(light, both) * kPairRatio < std::min(misfit(light, first), misfit(light, second));
}

bool Judge::missing(std::size_t light) const {
  const Place& place = places_[light];
  if (!silent(light) || !expected_bright(light)) return false;
  const std::vector<Combination::Term>& around = place.all.sum.terms;
  const auto heard = std::count_if(around.begin(), around.end(), [&](const auto& term) { return !silent(term.light); });
  return 2 * heard > std::ssize(around);
}

bool Judge::expected_bright(std::size_t light) const {
  return places_[light].usual < kPredictable &&
         places_[light].all.norm > std::max(kSeen * space_.largest_dark_norm(), kBright * median_norm_);
}

}  // namespace lightstage::capture
