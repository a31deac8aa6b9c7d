// How smoothly a method's pictures change while the light moves: jumps from frame to frame, and how straight a shadow's edge runs through time.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/image.h"

namespace lightstage::model {

// Second differences of frames that follow each other, v(t-1) - 2 v(t) + v(t+1), each as the root of its mean square over mask and channels: 0 where
// every pixel changes evenly, large where the picture jumps or flickers.
class SecondDifferences {
 public:
  // The next frame; of the size of those before. `mask` as model/metrics.h. Throws BadInput for another size.
  void add(core::Image frame, core::ImageView mask);

  // Of all so far; 0 for fewer than three frames.
  double largest() const { return largest_; }
  double mean() const;

 private:
  std::vector<core::Image> last_two_;
  double largest_ = 0, sum_ = 0;
  std::size_t count_ = 0;
};

// A shadow's edge along one row of the picture, frame by frame.
struct ShadowEdge {
  int row = 0;
  int sign = 1;           // +1 where it is bright to the right of the edge
  std::vector<double> x;  // pixels
  std::vector<double>
      levels;  // the luminance half way between its bright and its dark side, a line over time: where x is
};

// The edge that moves farthest, most clearly and most evenly through frames of one size inside the mask: by dynamic programming over each row for the path of
// at most three pixels a frame along which luminance changes most in space and time at once (an edge of the subject itself stands still and does not count); of all rows
// the one with the largest product of that change and the way (pixels) that the line through the path goes, divided by the square of one more than the line's residual
// (pixels). Nothing for fewer than three frames, or where no edge goes three pixels. Throws BadInput when sizes differ.
std::optional<ShadowEdge> find_moving_edge(std::span<const core::Image> frames, core::ImageView mask);

// Where the luminance of one frame's row (one pixel high, one channel or more) crosses the level of frame `t` of the edge in the same sense, nearest to
// where the edge is and at most `reach` pixels from there; linear between pixels. Nothing where it does not.
std::optional<double> edge_near(core::ImageView row, const ShadowEdge& edge, std::size_t t, double reach);

// The line of least squares through the positions that there are, x = offset + slope t.
struct LineFit {
  double slope = 0;     // pixels a frame
  double offset = 0;    // pixels
  double residual = 0;  // root of the mean squared distance in x, pixels
  std::size_t frames = 0;
};
// Nothing for fewer than two positions.
std::optional<LineFit> fit_line(std::span<const std::optional<double>> x);

}  // namespace lightstage::model
