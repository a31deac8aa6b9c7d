#include "model/smoothness.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/parallel.h"
#include "model/judging/comparison.h"

namespace lightstage::model {

namespace {

constexpr int kLargestStep = 3;     // of an edge, pixels a frame
constexpr double kLeastTravel = 3;  // pixels from the first frame to the last
constexpr int kPlateau = 4;         // so many pixels from the edge its two sides are measured

// Luminance of one row of all frames: time down, x to the right.
core::Image strip_of(std::span<const core::Image> frames, int row) {
  core::Image strip(int(frames.size()), frames.front().width(), 1);
  for (std::size_t t = 0; t < frames.size(); ++t) {
    const core::ImageView line = frames[t].view().crop(row, 0, 1, frames[t].width());
    const core::Image luminance = core::to_luminance(line);
    std::copy(luminance.values().begin(), luminance.values().end(), strip.pixel(int(t), 0));
  }
  return strip;
}

// A path through the gaps between neighbouring pixels, a gap a frame, and the change along it.
struct Path {
  std::vector<int> gaps;
  double change = 0;
};

// How much luminance changes at a gap in space, in the sense of `sign`, and in time: the geometric mean of both.
double change_at(const core::Image& strip, int t, int gap, int sign) {
  const double in_space = sign * (double(strip(t, gap + 1)) - double(strip(t, gap)));
  if (in_space <= 0) return 0;
  const int before = std::max(t - 1, 0), after = std::min(t + 1, strip.height() - 1);
  const double in_time = (double(strip(after, gap)) + double(strip(after, gap + 1)) - double(strip(before, gap)) -
                          double(strip(before, gap + 1))) /
                         (2.0 * (after - before));
  return std::sqrt(in_space * std::abs(in_time));
}

Path best_path(const core::Image& strip, core::ImageView mask, int row, int sign) {
  const int frames = strip.height(), gaps = strip.width() - 1;
  const auto inside = [&](int x) { return mask.empty() || mask(row, x) > 0.5f; };
  std::vector<std::vector<double>> best(std::size_t(frames), std::vector<double>(std::size_t(gaps), 0.0));
  std::vector<std::vector<int>> from = std::vector(std::size_t(frames), std::vector<int>(std::size_t(gaps), 0));
  for (int t = 0; t < frames; ++t) {
    for (int gap = 0; gap < gaps; ++gap) {
      double& here = best[std::size_t(t)][std::size_t(gap)];
      here = inside(gap) && inside(gap + 1) ? change_at(strip, t, gap, sign) : 0;
      if (t == 0) continue;
      int chosen = gap;
      for (int g = std::max(0, gap - kLargestStep); g <= std::min(gaps - 1, gap + kLargestStep); ++g) {
        if (best[std::size_t(t - 1)][std::size_t(g)] > best[std::size_t(t - 1)][std::size_t(chosen)]) chosen = g;
      }
      from[std::size_t(t)][std::size_t(gap)] = chosen;
      here += best[std::size_t(t - 1)][std::size_t(chosen)];
    }
  }
  const auto last = std::max_element(best.back().begin(), best.back().end());
  Path path{std::vector<int>(std::size_t(frames)), *last};
  int gap = int(last - best.back().begin());
  for (int t = frames - 1; t >= 0; --t) {
    path.gaps[std::size_t(t)] = gap;
    gap = from[std::size_t(t)][std::size_t(gap)];
  }
  return path;
}

// The edge in one row; nothing where some frame has none along the path. Levels half way between both sides follow a line over time: taken frame by
// frame they would jump with the whole pixels at which the sides are measured.
std::optional<ShadowEdge> edge_along(const core::Image& strip, const Path& path, int row, int sign) {
  std::vector<std::optional<double>> half_way;
  for (int t = 0; t < strip.height(); ++t) {
    const int gap = path.gaps[std::size_t(t)];
    const int left = std::max(0, gap + 1 - kPlateau), right = std::min(strip.width() - 1, gap + kPlateau);
    half_way.push_back((double(strip(t, left)) + double(strip(t, right))) / 2);
  }
  const LineFit level = fit_line(half_way).value();
  ShadowEdge edge{.row = row, .sign = sign, .x = {}, .levels = {}};
  for (int t = 0; t < strip.height(); ++t) {
    edge.x.push_back(path.gaps[std::size_t(t)] + 0.5);
    edge.levels.push_back(level.offset + level.slope * t);
    const auto x = edge_near(strip.view().crop(t, 0, 1, strip.width()), edge, std::size_t(t), kPlateau);
    if (!x) return std::nullopt;
    edge.x.back() = *x;
  }
  return edge;
}

struct Candidate {
  std::optional<ShadowEdge> edge;
  double merit = 0;
};

Candidate best_in_row(std::span<const core::Image> frames, core::ImageView mask, int row) {
  const core::Image strip = strip_of(frames, row);
  Candidate best;
  for (const int sign : {-1, 1}) {
    const Path path = best_path(strip, mask, row, sign);
    if (path.change <= 0) continue;
    std::optional<ShadowEdge> edge = edge_along(strip, path, row, sign);
    if (!edge) continue;
    const std::vector<std::optional<double>> positions(edge->x.begin(), edge->x.end());
    const LineFit line = fit_line(positions).value();
    const double travel = std::abs(line.slope) * double(frames.size() - 1);
    if (travel < kLeastTravel) continue;
    const double merit = path.change * travel / ((1 + line.residual) * (1 + line.residual));
    if (merit > best.merit) best = {std::move(edge), merit};
  }
  return best;
}

}  // namespace

void SecondDifferences::add(core::Image frame, core::ImageView mask) {
  if (!last_two_.empty()) Comparison(frame, last_two_.back(), mask);
  if (last_two_.size() == 2) {
    const core::Image &first = last_two_[0], &second = last_two_[1];
    const double squared = Comparison(first, frame, mask).mean([&](int y, int x, int c) {
      const double difference = double(first(y, x, c)) - 2 * double(second(y, x, c)) + double(frame(y, x, c));
      return difference * difference;
    });
    largest_ = std::max(largest_, std::sqrt(squared));
    sum_ += std::sqrt(squared);
    ++count_;
    last_two_.erase(last_two_.begin());
  }
  last_two_.push_back(std::move(frame));
}

double SecondDifferences::mean() const {
  return count_ == 0 ? 0 : sum_ / double(count_);
}

std::optional<ShadowEdge> find_moving_edge(std::span<const core::Image> frames, core::ImageView mask) {
  if (frames.size() < 3) return std::nullopt;
  for (const core::Image& frame : frames) Comparison(frame, frames.front(), mask);
  if (frames.front().width() < 2) return std::nullopt;
  std::vector<Candidate> rows(std::size_t(frames.front().height()));
  core::parallel_for(rows.size(), 4, [&](std::size_t first, std::size_t last) {
    for (std::size_t row = first; row < last; ++row) rows[row] = best_in_row(frames, mask, int(row));
  });
  return std::max_element(rows.begin(), rows.end(),
                          [](const Candidate& a, const Candidate& b) { return a.merit < b.merit; })
      ->edge;
}

std::optional<double> edge_near(core::ImageView row, const ShadowEdge& edge, std::size_t t, double reach) {
  const core::Image luminance = core::to_luminance(row);
  const double expected = edge.x.at(t), level = edge.levels.at(t);
  std::optional<double> nearest;
  for (int x = 0; x + 1 < row.width(); ++x) {
    const double here = edge.sign * (double(luminance(0, x)) - level);
    const double next = edge.sign * (double(luminance(0, x + 1)) - level);
    if (!(here < 0 && next >= 0)) continue;
    const double crossing = x + here / (here - next);
    const double distance = std::abs(crossing - expected);
    if (distance <= reach && (!nearest || distance < std::abs(*nearest - expected))) nearest = crossing;
  }
  return nearest;
}

std::optional<LineFit> fit_line(std::span<const std::optional<double>> x) {
  double n = 0, sum_t = 0, sum_x = 0;
  for (std::size_t t = 0; t < x.size(); ++t) {
    if (!x[t]) continue;
    n += 1;
    sum_t += double(t);
    sum_x += *x[t];
  }
  if (n < 2) return std::nullopt;
  const double mean_t = sum_t / n, mean_x = sum_x / n;
  double tt = 0, tx = 0;
  for (std::size_t t = 0; t < x.size(); ++t) {
    if (!x[t]) continue;
    tt += (double(t) - mean_t) * (double(t) - mean_t);
    tx += (double(t) - mean_t) * (*x[t] - mean_x);
  }
  LineFit fit{.slope = tx / tt, .offset = mean_x - tx / tt * mean_t, .residual = 0, .frames = std::size_t(n)};
  double squares = 0;
  for (std::size_t t = 0; t < x.size(); ++t) {
    if (x[t]) squares += std::pow(*x[t] - fit.offset - fit.slope * double(t), 2);
  }
  fit.residual = std::sqrt(squares / n);
  return fit;
}

}  // namespace lightstage::model
