#include "align/motion_track.h"

#include <algorithm>
#include <cmath>

#include "align/tone/tone.h"
#include "core/display.h"
#include "core/error.h"
#include "core/image_file.h"

namespace lightstage::align {

namespace {

// later - earlier, exact even where the difference does not fit into 64 bits with sign.
std::uint64_t elapsed(core::Nanoseconds earlier, core::Nanoseconds later) {
  return static_cast<std::uint64_t>(later) - static_cast<std::uint64_t>(earlier);
}

void require_mask_of(core::ImageView mask, core::ImageSize size, const std::string& what) {
  if (mask.empty()) return;
  if (mask.channels() != 1 || mask.width() != size.width || mask.height() != size.height) {
    throw core::BadInput(what + ": the mask has " + std::to_string(mask.width()) + " x " +
                         std::to_string(mask.height()) + " pixels, the picture " + std::to_string(size.width) + " x " +
                         std::to_string(size.height));
  }
}

bool inside(core::ImageView mask, int y, int x) {
  return mask.empty() || mask(y, x) > 0.5F;
}

// The flow at a time is the sum of the knots' flows times these; constant motion is kept because they add up to 1.
struct Weights {
  std::size_t first = 0;  // the knot of the first weight
  std::array<double, 4> of{};
};

// Velocity at the middle one of three knots, by their flows: the derivative there of the parabola through them. h: times between them.
std::array<double, 3> parabola_slope(double h0, double h1) {
  return {-h1 / (h0 * (h0 + h1)), (h1 - h0) / (h0 * h1), h0 / (h1 * (h0 + h1))};
}

// The same at the first one of three.
std::array<double, 3> parabola_end_slope(double h0, double h1) {
  return {-(2 * h0 + h1) / (h0 * (h0 + h1)), (h0 + h1) / (h0 * h1), -h0 / (h1 * (h0 + h1))};
}

std::vector<float> lengths_within(const FlowField& flow, core::ImageView mask, const std::string& what) {
  if (flow.channels() != 2) throw core::BadInput(what + ": a flow needs two channels");
  require_mask_of(mask, flow.size(), what);
  std::vector<float> lengths;
  for (int y = 0; y < flow.height(); ++y) {
    for (int x = 0; x < flow.width(); ++x) {
      if (inside(mask, y, x)) lengths.push_back(std::hypot(flow(y, x, 0), flow(y, x, 1)));
    }
  }
  return lengths;
}

}  // namespace

void MotionTrack::add(core::Nanoseconds time, FlowField flow, core::Image confidence) {
  if (flow.channels() != 2) throw core::BadInput("motion track: a flow needs two channels");
  core::require_finite(flow, "motion track: the flow");
  require_mask_of(confidence, flow.size(), "motion track: confidence");
  core::require_finite(confidence, "motion track: the confidence");
  if (!knots_.empty() && knots_.front().flow.size() != flow.size()) {
    throw core::BadInput("motion track: a flow of " + std::to_string(flow.width()) + " x " +
                         std::to_string(flow.height()) + " pixels among flows of " +
                         std::to_string(knots_.front().flow.width()) + " x " +
                         std::to_string(knots_.front().flow.height()));
  }
  const std::size_t place = knot_from(time);
  if (place < knots_.size() && knots_[place].time == time) {
    throw core::BadInput("motion track: two tracking frames at time " + std::to_string(time) + " ns");
  }
  knots_.insert(knots_.begin() + std::ptrdiff_t(place), Knot{time, std::move(flow), std::move(confidence)});
}

std::size_t MotionTrack::knot_from(core::Nanoseconds time) const {
  const auto place = std::lower_bound(knots_.begin(), knots_.end(), time,
                                      [](const Knot& knot, core::Nanoseconds t) { return knot.time < t; });
  return std::size_t(place - knots_.begin());
}

FlowField MotionTrack::at(core::Nanoseconds time) const {
  if (knots_.empty()) throw core::BadInput("motion track: no tracking frames");
  const std::size_t after = knot_from(time);
  if (after == knots_.size()) return knots_.back().flow;
  if (after == 0 || knots_[after].time == time) return knots_[after].flow;
  const std::size_t before = after - 1;
  const auto span = [&](std::size_t knot) { return double(elapsed(knots_[knot].time, knots_[knot + 1].time)); };
  const double whole = span(before);
  const double s = double(elapsed(knots_[before].time, time)) / whole;

  Weights weights;
  weights.first = before;
  if (between_ == Between::kLinear || knots_.size() == 2) {
    weights.of = {1 - s, s};
  } else {
    // Cubic Hermite: values at both ends and velocities times the time between them.
    const double value_after = s * s * (3 - 2 * s);
    const double slope_before = s * (1 - s) * (1 - s) * whole, slope_after = -s * s * (1 - s) * whole;
    const bool starts = before == 0, ends = after + 1 == knots_.size();
    weights.first = starts ? before : before - 1;
    const std::size_t own = before - weights.first;
    weights.of[own] += 1 - value_after;
    weights.of[own + 1] += value_after;
    const auto add = [&](std::size_t place, const std::array<double, 3>& slope, double times) {
      for (std::size_t i = 0; i < 3; ++i) weights.of[place + i] += times * slope[i];
    };
    if (starts) {
      add(0, parabola_end_slope(whole, span(after)), slope_before);
    } else {
      add(0, parabola_slope(span(before - 1), whole), slope_before);
    }
    if (ends) {
      // The end slope seen from behind: mirrored in time.
      const std::array<double, 3> mirrored = parabola_end_slope(whole, span(before - 1));
      add(own - 1, {-mirrored[2], -mirrored[1], -mirrored[0]}, slope_after);
    } else {
      add(own, parabola_slope(whole, span(after)), slope_after);
    }
  }
  FlowField flow(knots_[before].flow.size());
  const std::span<float> values = flow.values();
  const std::size_t used = std::min<std::size_t>(weights.of.size(), knots_.size() - weights.first);
  for (std::size_t i = 0; i < values.size(); ++i) {
    double sum = 0;
    for (std::size_t k = 0; k < used; ++k) sum += weights.of[k] * double(knots_[weights.first + k].flow.values()[i]);
    values[i] = static_cast<float>(sum);
  }
  return flow;
}

core::Image MotionTrack::confidence_at(core::Nanoseconds time) const {
  if (knots_.empty()) throw core::BadInput("motion track: no tracking frames");
  const auto of = [&](const Knot& knot) {
    if (!knot.confidence.empty()) return knot.confidence;
    core::Image certain(knot.flow.height(), knot.flow.width(), 1);
    std::fill(certain.values().begin(), certain.values().end(), 1.0F);
    return certain;
  };
  const std::size_t after = knot_from(time);
  if (after == knots_.size()) return of(knots_.back());
  if (after == 0 || knots_[after].time == time) return of(knots_[after]);
  core::Image confidence = of(knots_[after - 1]);
  const core::Image later = of(knots_[after]);
  const double share =
      double(elapsed(knots_[after - 1].time, time)) / double(elapsed(knots_[after - 1].time, knots_[after].time));
  for (std::size_t i = 0; i < confidence.values().size(); ++i) {
    float& value = confidence.values()[i];
    value = float((1 - share) * double(value) + share * double(later.values()[i]));
  }
  return confidence;
}

std::optional<core::Nanoseconds> MotionTrack::settled_until() const {
  // Velocity at a knot needs the next one; at the first, the next two.
  if (between_ == Between::kLinear || knots_.empty()) {
    return knots_.empty() ? std::nullopt : std::optional(knots_.back().time);
  }
  return knots_.size() < 3 ? std::nullopt : std::optional(knots_[knots_.size() - 2].time);
}

void MotionTrack::forget_before(core::Nanoseconds time) {
  // The knots of the interval that holds `time` and two before it: the velocity at its start needs one, or where it is among the last
  // three, as the end of a pass is, the velocity at its end.
  constexpr std::size_t kKept = 3;
  const std::size_t from = knot_from(time);
  if (from > kKept) knots_.erase(knots_.begin(), knots_.begin() + std::ptrdiff_t(from - kKept));
}

double median_motion_px(const FlowField& flow, core::ImageView mask) {
  const std::vector<float> lengths = lengths_within(flow, mask, "median motion");
  return lengths.empty() ? 0 : core::quantile(lengths, 0.5);
}

bool stands_still(const FlowField& flow, core::ImageView mask) {
  constexpr double kMedianPx = 0.02, kMostPx = 0.08;
  const std::vector<float> lengths = lengths_within(flow, mask, "standing still");
  return lengths.empty() || (core::quantile(lengths, 0.5) < kMedianPx && core::quantile(lengths, 0.95) < kMostPx);
}

double residual(core::ImageView reference, core::ImageView warped, core::ImageView mask) {
  if (reference.size() != warped.size()) throw core::BadInput("alignment residual: the pictures differ in size");
  require_mask_of(mask, reference.size(), "alignment residual");
  const double white = white_level(core::to_luminance(reference));
  double sum = 0;
  std::size_t count = 0;
  for (int y = 0; y < reference.height(); ++y) {
    for (int x = 0; x < reference.width(); ++x) {
      if (!inside(mask, y, x)) continue;
      for (int c = 0; c < reference.channels(); ++c) {
        const double a = core::display_encode(static_cast<float>(double(reference(y, x, c)) / white));
        const double b = core::display_encode(static_cast<float>(double(warped(y, x, c)) / white));
        sum += (a - b) * (a - b);
        ++count;
      }
    }
  }
  return count == 0 ? 0 : std::sqrt(sum / double(count));
}

}  // namespace lightstage::align
