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

}  // namespace

void MotionTrack::add(core::Nanoseconds time, FlowField flow) {
  if (flow.channels() != 2) throw core::BadInput("motion track: a flow needs two channels");
  core::require_finite(flow, "motion track: the flow");
  if (!knots_.empty() && knots_.front().flow.size() != flow.size()) {
    throw core::BadInput("motion track: a flow of " + std::to_string(flow.width()) + " x " +
                         std::to_string(flow.height()) + " pixels among flows of " +
                         std::to_string(knots_.front().flow.width()) + " x " +
                         std::to_string(knots_.front().flow.height()));
  }
  const auto place = std::lower_bound(knots_.begin(), knots_.end(), time,
                                      [](const Knot& knot, core::Nanoseconds t) { return knot.time < t; });
  if (place != knots_.end() && place->time == time) {
    throw core::BadInput("motion track: two tracking frames at time " + std::to_string(time) + " ns");
  }
  knots_.insert(place, Knot{time, std::move(flow)});
}

FlowField MotionTrack::at(core::Nanoseconds time) const {
  if (knots_.empty()) throw core::BadInput("motion track: no tracking frames");
  const auto after = std::lower_bound(knots_.begin(), knots_.end(), time,
                                      [](const Knot& knot, core::Nanoseconds t) { return knot.time < t; });
  if (after == knots_.end()) return knots_.back().flow;
  if (after == knots_.begin() || after->time == time) return after->flow;
  const Knot& before = *std::prev(after);
  const double share = double(elapsed(before.time, time)) / double(elapsed(before.time, after->time));
  FlowField flow = before.flow;
  const std::span<const float> later = after->flow.values();
  for (std::size_t i = 0; i < later.size(); ++i) {
    flow.values()[i] = static_cast<float>((1 - share) * double(flow.values()[i]) + share * double(later[i]));
  }
  return flow;
}

double median_motion_px(const FlowField& flow, core::ImageView mask) {
  if (flow.channels() != 2) throw core::BadInput("median motion: a flow needs two channels");
  require_mask_of(mask, flow.size(), "median motion");
  std::vector<float> lengths;
  for (int y = 0; y < flow.height(); ++y) {
    for (int x = 0; x < flow.width(); ++x) {
      if (inside(mask, y, x)) lengths.push_back(std::hypot(flow(y, x, 0), flow(y, x, 1)));
    }
  }
  if (lengths.empty()) return 0;
  const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  return double(*middle);
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
