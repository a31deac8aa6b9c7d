#include "capture/light_check.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>

#include "capture/light_check/judge.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kLeastLights = 16, kLeastDark = 2;
// Neighbours predict sound pictures to 0.1 to 0.4 (150 lights, 40 lights).
constexpr double kNoOrder = 0.65;
// A light whose own place was found to be shown by another one: weaker evidence of where it is itself will do.
constexpr double kClosingRatio = 1.2;
// Of weak lights: see the header.
constexpr double kLevelDeviations = 5, kLevelPerMisfit = 1.5, kLeastLevelSpread = 0.08;
constexpr double kWellPredicted = 0.4, kRightShape = 0.7, kMostOfWeak = 0.6;

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2g", value);
  return text;
}
std::string name(std::size_t light) {
  return "light " + std::to_string(light);
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

class Check {
 public:
  explicit Check(const PictureSpace& space) : space_(space), judge_(space) {}

  LightCheckReport run() {
    if (judge_.median_misfit() > kNoOrder) return nothing_fits();
    if (!find_misplaced_and_double()) return nothing_fits();
    close_chains();
    find_dead();
    name_misplaced();
    find_weak();
    for (std::size_t i = 0; i < space_.light_count(); ++i) {
      const bool judged = space_.has_picture(i) && !judge_.silent(i) && !judge_.prediction(i).terms.empty();
      if (!judged && !named_.contains(i)) report_.unjudged.push_back(static_cast<int>(i));
    }
    std::sort(report_.findings.begin(), report_.findings.end(),
              [](const LightFinding& a, const LightFinding& b) { return a.light < b.light; });
    return std::move(report_);
  }

 private:
  void add(LightTrouble trouble, std::size_t light, const std::vector<std::size_t>& others, const std::string& text) {
    report_.findings.push_back(
        {trouble, static_cast<int>(light), std::vector<int>(others.begin(), others.end()), name(light) + text});
    named_.insert(light);
    if (trouble == LightTrouble::kSwapped) named_.insert(others.begin(), others.end());
  }

  void add_instead(std::size_t light, std::size_t other, double ratio) {
    add(LightTrouble::kDouble, light, {other},
        " is not lit, its output lights " + name(other) + " instead, which has an output of its own (fits " +
            number(ratio) + " times better so)");
  }

  LightCheckReport nothing_fits() const {
    LightCheckReport report;
    report.too_little =
        "too many pictures do not fit in with their neighbours': the stage file's positions may be another stage's, "
        "whole "
        "boards may be exchanged, or the subject has moved";
    for (std::size_t i = 0; i < space_.light_count(); ++i) report.unjudged.push_back(static_cast<int>(i));
    return report;
  }

  // False where so many lights are suspect that there is nothing left to judge them by.
  bool find_misplaced_and_double() {
    std::size_t suspects = 0;
    while (const std::optional<Judge::Suspicion> found = judge_.plainest()) {
      const auto [kind, light, other, ratio, score] = *found;
      if (++suspects > space_.light_count() / 4) return false;
      const std::string times = " (fits " + number(ratio) + " times better so)";
      switch (kind) {
        case Judge::Kind::kPair:
          shows_[light] = {other, ratio};
          shows_[other] = {light, ratio};
          judge_.distrust(other);
          break;
        case Judge::Kind::kElsewhere:
          shows_[light] = {other, ratio};
          break;
        case Judge::Kind::kSame:
          if (judge_.shows_both_places(light, light, other)) {
            add(LightTrouble::kDouble, light, {other}, " lights " + name(other) + " too" + times);
            add(LightTrouble::kDouble, other, {light}, " lights " + name(light) + " too" + times);
            judge_.distrust(other);
          } else {
            add_instead(light, other, ratio);
          }
          break;
        case Judge::Kind::kBoth:
          add(LightTrouble::kDouble, light, {other}, " lights " + name(other) + " too" + times);
          break;
      }
      judge_.distrust(light);
    }
    return true;
  }

  // A place that another light shows: what is seen there instead?
  void close_chains() {
    for (bool more = true; more;) {
      more = false;
      for (const auto& [light, shown] : std::map(shows_)) {
        const std::size_t next = shown.first;
        if (shows_.contains(next) || named_.contains(next) || judge_.silent(next) || !space_.has_picture(next))
          continue;
        const Judge::Suspicion place = judge_.best_place(next);
        if (place.ratio < kClosingRatio) continue;
        shows_[next] = {place.other, place.ratio};
        if (judge_.trusted()[next]) judge_.distrust(next);
        more = true;
      }
    }
  }

  void find_dead() {
    std::set<std::size_t> dead;
    for (bool more = true; more;) {
      std::vector<std::size_t> found;
      for (std::size_t i = 0; i < space_.light_count(); ++i) {
        if (space_.has_picture(i) && judge_.trusted()[i] && judge_.missing(i)) found.push_back(i);
      }
      for (const std::size_t light : found) {
        judge_.distrust(light);
        dead.insert(light);
      }
      more = !found.empty();
    }
    for (const std::size_t light : dead) {
      // Its LED is well, only lit by another output: that one's LED, which no camera sees, is its own.
      const auto by =
          std::find_if(shows_.begin(), shows_.end(), [&](const auto& s) { return s.second.first == light; });
      if (by != shows_.end()) {
        shows_[light] = {by->first, by->second.second};
        continue;
      }
      add(LightTrouble::kDead, light, {},
          " is dead (or lit all the time): changes the picture by " + number(std::abs(space_.mean(light))) +
              " where its neighbours predict " + number(space_.mean(judge_.prediction(light))));
    }
  }

  void name_misplaced() {
    for (const auto& [light, shown] : shows_) {
      if (named_.contains(light)) continue;
      std::vector<std::size_t> round;
      double least = shown.second;
      for (std::size_t at = shown.first; at != light && shows_.contains(at) && round.size() <= shows_.size();
           at = shows_[at].first) {
        round.push_back(at);
        least = std::min(least, shows_[at].second);
      }
      const std::string times = " (fits at least " + number(least) + " times better so)";
      const bool closed = !round.empty() && shows_[round.back()].first == light;
      if (closed && round.size() == 1) {
        add(LightTrouble::kSwapped, light, round, " and " + name(round[0]) + " are swapped" + times);
      } else if (closed) {
        std::string text;
        for (const std::size_t at : round) text += " shows the place of " + name(at) + ", which";
        add(LightTrouble::kSwapped, light, round, text + " shows the place of " + name(light) + times);
      }
    }
    for (const auto& [light, shown] : shows_) {
      if (named_.contains(light)) continue;
      // Its light was found in its own place: then that LED is lit by both outputs.
      if (judge_.trusted()[shown.first] && !judge_.silent(shown.first)) {
        add_instead(light, shown.first, shown.second);
        continue;
      }
      add(LightTrouble::kSwapped, light, {shown.first},
          " shows the place of " + name(shown.first) + " (fits " + number(shown.second) + " times better there)");
    }
  }

  void find_weak() {
    while (true) {
      std::vector<double> levels;  // logarithms
      std::vector<std::pair<std::size_t, double>> all;
      for (std::size_t i = 0; i < space_.light_count(); ++i) {
        const Combination& expected = judge_.prediction(i);
        if (!judge_.trusted()[i] || judge_.silent(i) || expected.terms.empty()) continue;
        const double level = space_.inner(expected, i) / space_.inner(expected, expected);
        if (level <= 0) continue;
        all.emplace_back(i, std::log(level));
        if (judge_.misfit(i, i) < kWellPredicted) levels.push_back(std::log(level));
      }
      if (levels.size() < kLeastLights / 2) return;
      const double middle = median(levels);
      for (double& v : levels) v = std::abs(v - middle);
      const double spread = std::max(kLeastLevelSpread, 1.4826 * median(levels));
      std::optional<std::size_t> weakest;
      double most = 1;
      for (const auto& [light, level] : all) {
        const double misfit = judge_.misfit(light, light);
        const double excess = -level / (kLevelDeviations * spread + kLevelPerMisfit * misfit);
        if (judge_.expected_bright(light) && misfit < kRightShape && level < std::log(kMostOfWeak) && excess > most) {
          most = excess;
          weakest = light;
        }
      }
      if (!weakest) return;
      const double seen = space_.mean(*weakest), predicted = space_.mean(judge_.prediction(*weakest));
      add(LightTrouble::kWeak, *weakest, {},
          " is weak: changes the picture by " + number(seen) + " where its neighbours predict " + number(predicted));
      judge_.distrust(*weakest);
    }
  }

  const PictureSpace& space_;
  Judge judge_;
  LightCheckReport report_;
  std::set<std::size_t> named_;
  std::map<std::size_t, std::pair<std::size_t, double>> shows_;  // another place, and the ratio that says so
};

}  // namespace

LightCheckReport check_lights(std::span<const core::Vec3> light_positions, std::span<const CameraPictures> cameras) {
  std::vector<core::Direction> directions;
  for (const core::Vec3& position : light_positions) directions.push_back(core::Direction::from_vector(position));
  const PictureSpace space(directions, cameras);

  LightCheckReport nothing;
  std::size_t dark = cameras.empty() ? 0 : cameras.front().dark.size();
  for (const CameraPictures& camera : cameras) dark = std::min(dark, camera.dark.size());
  if (light_positions.size() < kLeastLights) {
    nothing.too_little = "lights are judged by their neighbours: that needs " + std::to_string(kLeastLights) +
                         " lights, this stage has " + std::to_string(light_positions.size());
  } else if (cameras.empty() || dark < kLeastDark) {
    nothing.too_little = "what is noise is judged by dark frames: that needs " + std::to_string(kLeastDark) +
                         " of each camera, there are " + std::to_string(dark);
  }
  if (!nothing.too_little.empty()) {
    for (std::size_t i = 0; i < light_positions.size(); ++i) nothing.unjudged.push_back(static_cast<int>(i));
    return nothing;
  }
  return Check(space).run();
}

}  // namespace lightstage::capture
