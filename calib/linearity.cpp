#include "calib/linearity.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "calib/robust/quantile.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/text.h"

namespace lightstage::calib {

namespace {

constexpr int kCell = 16;
constexpr double kUnclipped = 0.98;     // of the value at which the camera clips
constexpr double kClippedShare = 1e-3;  // of a picture's values: fewer at the top may be highlights
constexpr double kRelative = 0.005;     // deviations smaller than this weigh alike, however little noise there is
constexpr int kBins = 24;

// Mean of a cell in one picture, and what its noise makes of that.
struct CellMean {
  double mean = 0, variance = 0;  // of the mean
  bool usable = false;            // nothing clipped
};

// A place of the scene in one channel.
struct Place {
  std::vector<CellMean> means;  // a picture
  double brightness = 0;        // signal a second
};

void check(std::span<const ExposedPicture> pictures) {
  std::set<double> times;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const std::string what = "linearity: picture " + std::to_string(i);
    if (!(pictures[i].seconds > 0) || !std::isfinite(pictures[i].seconds)) {
      throw core::BadInput(what + ": its exposure time must be positive");
    }
    if (pictures[i].picture.size() != pictures.front().picture.size()) {
      throw core::BadInput(what + " is of another size than picture 0");
    }
    core::require_finite(pictures[i].picture, what);
    times.insert(pictures[i].seconds);
  }
  if (times.size() < 3) throw core::BadInput("linearity: three different exposure times are needed at least");
}

// The largest value of all pictures, where so many values lie at it that it can only be the end of the range.
std::optional<double> clipping_value(std::span<const ExposedPicture> pictures) {
  double largest = -HUGE_VAL;
  for (const ExposedPicture& p : pictures) {
    for (int y = 0; y < p.picture.height(); ++y) {
      const float* row = p.picture.row(y);
      largest = std::max(largest, double(*std::max_element(row, row + p.picture.width() * p.picture.channels())));
    }
  }
  for (const ExposedPicture& p : pictures) {
    std::size_t at_end = 0;
    for (int y = 0; y < p.picture.height(); ++y) {
      const float* row = p.picture.row(y);
      at_end += std::size_t(std::count_if(row, row + p.picture.width() * p.picture.channels(),
                                          [&](float v) { return double(v) >= largest - 1e-6 * std::abs(largest); }));
    }
    if (double(at_end) >= kClippedShare * double(p.picture.size().value_count())) return largest;
  }
  return std::nullopt;
}

CellMean cell_mean(core::ImageView picture, int top, int left, int channel, double limit) {
  double sum = 0, squares = 0;
  CellMean cell{0, 0, true};
  for (int y = top; y < top + kCell; ++y) {
    for (int x = left; x < left + kCell; ++x) {
      const double v = double(picture(y, x, channel));
      sum += v;
      squares += v * v;
      cell.usable = cell.usable && v < limit;
    }
  }
  const double n = kCell * kCell;
  cell.mean = sum / n;
  // Texture of the scene is in it as well, which only makes cells of much of it count for less.
  cell.variance = std::max(0.0, squares / n - cell.mean * cell.mean) / n;
  return cell;
}

std::vector<Place> read_places(std::span<const ExposedPicture> pictures, double limit) {
  std::vector<Place> places;
  const core::ImageSize size = pictures.front().picture.size();
  for (int top = 0; top + kCell <= size.height; top += kCell) {
    for (int left = 0; left + kCell <= size.width; left += kCell) {
      for (int c = 0; c < size.channels; ++c) {
        Place place;
        std::set<double> times;
        for (const ExposedPicture& p : pictures) {
          place.means.push_back(cell_mean(p.picture, top, left, c, limit));
          if (place.means.back().usable) times.insert(p.seconds);
        }
        if (times.size() >= 2) places.push_back(std::move(place));
      }
    }
  }
  return places;
}

double weight_of(const CellMean& cell, double signal) {
  return 1 / (std::pow(kRelative * signal, 2) + cell.variance + 1e-18);
}

// Brightness of every place and the black level that they share; the places' own unknowns are eliminated one by one.
double fit_lines(std::vector<Place>& places, std::span<const ExposedPicture> pictures) {
  double black = 0;
  for (int round = 0; round < 8; ++round) {
    double matrix = 0, side = 0;
    for (const Place& place : places) {
      double w_t = 0, w_tt = 0, w_1 = 0, w_m = 0, w_mt = 0;
      for (std::size_t i = 0; i < pictures.size(); ++i) {
        const CellMean& cell = place.means[i];
        if (!cell.usable) continue;
        const double t = pictures[i].seconds;
        const double w = weight_of(cell, round == 0 ? cell.mean : place.brightness * t);
        w_1 += w;
        w_t += w * t;
        w_tt += w * t * t;
        w_m += w * cell.mean;
        w_mt += w * cell.mean * t;
      }
      matrix += w_1 - w_t * w_t / w_tt;
      side += w_m - w_t * w_mt / w_tt;
    }
    black = matrix > 0 ? side / matrix : 0;
    for (Place& place : places) {
      double w_tt = 0, w_mt = 0;
      for (std::size_t i = 0; i < pictures.size(); ++i) {
        const CellMean& cell = place.means[i];
        if (!cell.usable) continue;
        const double t = pictures[i].seconds;
        const double w = weight_of(cell, round == 0 ? cell.mean : place.brightness * t);
        w_tt += w * t * t;
        w_mt += w * t * (cell.mean - black);
      }
      place.brightness = w_mt / w_tt;
    }
  }
  return black;
}

struct Mean {
  double sum = 0, signal = 0, weights = 0;
  void add(double deviation, double at, double weight) {
    sum += weight * deviation;
    signal += weight * at;
    weights += weight;
  }
  LinearityPoint point() const { return {signal / weights, sum / weights}; }
};

void find_deviations(const std::vector<Place>& places, std::span<const ExposedPicture> pictures, double range,
                     LinearityReport& report) {
  std::vector<Mean> bins(kBins), by_picture(pictures.size());
  for (const Place& place : places) {
    for (std::size_t i = 0; i < pictures.size(); ++i) {
      const CellMean& cell = place.means[i];
      const double expected = place.brightness * pictures[i].seconds;
      if (!cell.usable || !(expected > 0)) continue;
      const double signal = expected / range, deviation = (cell.mean - report.black_level) / expected - 1;
      const double weight = expected * expected * weight_of(cell, expected);
      by_picture[i].add(deviation, signal, weight);
      bins[std::size_t(std::clamp(int(signal * kBins), 0, kBins - 1))].add(deviation, signal, weight);
    }
  }
  for (const Mean& bin : bins) {
    if (!(bin.weights > 0)) continue;
    const LinearityPoint point = bin.point();
    report.points.push_back(point);
    if (point.signal < kLinearFrom || point.signal > 0.95) continue;
    if (std::abs(point.deviation) < std::abs(report.largest_deviation)) continue;
    report.largest_deviation = std::abs(point.deviation);
    report.largest_at = point.signal;
  }
  for (const Mean& mean : by_picture) report.exposures.push_back(mean.weights > 0 ? mean.point() : LinearityPoint{});
}

// Half the variance of the difference of two cells, and their mean signal.
struct NoisePoint {
  double signal = 0, variance = 0;
};

std::vector<NoisePoint> noise_of_pairs(std::span<const ExposedPicture> pictures, double black, double limit) {
  std::map<double, std::vector<std::size_t>> by_time;
  for (std::size_t i = 0; i < pictures.size(); ++i) by_time[pictures[i].seconds].push_back(i);
  std::vector<NoisePoint> points;
  std::size_t times = 0;
  const core::ImageSize size = pictures.front().picture.size();
  for (const auto& [seconds, same] : by_time) {
    const std::size_t before = points.size();
    for (std::size_t k = 0; k + 1 < same.size(); k += 2) {
      const core::ImageView a = pictures[same[k]].picture, b = pictures[same[k + 1]].picture;
      for (int top = 0; top + kCell <= size.height; top += kCell) {
        for (int left = 0; left + kCell <= size.width; left += kCell) {
          for (int c = 0; c < size.channels; ++c) {
            double sum = 0, squares = 0, level = 0;
            bool usable = true;
            for (int y = top; y < top + kCell; ++y) {
              for (int x = left; x < left + kCell; ++x) {
                const double va = double(a(y, x, c)), vb = double(b(y, x, c));
                usable = usable && va < limit && vb < limit;
                sum += va - vb;
                squares += (va - vb) * (va - vb);
                level += 0.5 * (va + vb);
              }
            }
            const double n = kCell * kCell;
            if (usable) points.push_back({level / n - black, 0.5 * (squares - sum * sum / n) / (n - 1)});
          }
        }
      }
    }
    times += points.size() > before;
  }
  if (times < 3) points.clear();
  return points;
}

// variance = slope signal + constant; a variance measured on n pixels has a standard error in proportion to itself.
void photon_transfer(const std::vector<NoisePoint>& points, double full_range, LinearityReport& report) {
  if (points.empty()) return;
  double slope = 0, constant = 1;
  for (int round = 0; round < 10; ++round) {
    double w1 = 0, ws = 0, wss = 0, wv = 0, wsv = 0;
    for (const NoisePoint& p : points) {
      const double expected = std::max(slope * p.signal + constant, 1e-3 * std::abs(constant) + 1e-30);
      const double w = 1 / (expected * expected);
      w1 += w;
      ws += w * p.signal;
      wss += w * p.signal * p.signal;
      wv += w * p.variance;
      wsv += w * p.signal * p.variance;
    }
    const double determinant = w1 * wss - ws * ws;
    if (!(determinant > 0)) return;
    slope = (w1 * wsv - ws * wv) / determinant;
    constant = (wss * wv - ws * wsv) / determinant;
  }
  if (!(slope > 0)) return;
  report.electrons_per_unit = 1 / slope;
  if (constant > 0) report.read_noise_electrons = std::sqrt(constant) / slope;
  if (report.clips_at) report.full_well_electrons = full_range / slope;
}

}  // namespace

LinearityReport check_linearity(std::span<const ExposedPicture> pictures) {
  check(pictures);
  LinearityReport report;
  report.clips_at = clipping_value(pictures);
  const double limit = report.clips_at ? *report.clips_at * kUnclipped : HUGE_VAL;
  std::vector<Place> places = read_places(pictures, limit);
  if (places.empty()) {
    throw core::BadInput(
        "linearity: no part of the scene (16 x 16 pixels) is below clipping in two exposures; take shorter ones");
  }
  report.black_level = fit_lines(places, pictures);
  double range = report.clips_at ? *report.clips_at - report.black_level : 0;
  for (const Place& place : places) {
    for (std::size_t i = 0; i < pictures.size(); ++i) {
      if (!report.clips_at && place.means[i].usable) range = std::max(range, place.brightness * pictures[i].seconds);
    }
  }
  if (!(range > 0)) throw core::BadInput("linearity: the pictures grow no brighter with exposure time");
  find_deviations(places, pictures, range, report);
  photon_transfer(noise_of_pairs(pictures, report.black_level, limit), range, report);

  const std::string deviation = core::number_text(100 * report.largest_deviation, 2) + " % at " +
                                core::number_text(100 * report.largest_at, 2) + " % of the range";
  report.linear = report.largest_deviation <= kLinearTo && report.largest_at > 0;
  if (!(report.largest_at > 0)) {
    report.verdict = "no signal between 5 and 95 % of the range: take longer exposures";
  } else if (report.linear) {
    report.verdict = "linear: deviates by at most " + deviation;
  } else {
    report.verdict = "not linear: deviates by " + deviation + "; recover the response from display-encoded pictures";
  }
  return report;
}

}  // namespace lightstage::calib
