#include "align/agreement.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "align/motion_track.h"
#include "align/tone/tone.h"
#include "core/display.h"
#include "core/error.h"

namespace lightstage::align {

namespace {

constexpr double kMostTimesOverall = 3, kLeastOverall = 0.04, kMostOverall = 0.3;
constexpr double kMostTimesInCell = 4, kLeastInCell = 0.1;
constexpr double kLeastBelieved = 0.5;
constexpr std::size_t kFewestToCompare = 3;

double median(std::vector<double> values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::string rounded(double value) {
  return std::to_string(std::lround(value));
}

int cell_side(core::ImageSize size) {
  return std::max(8, std::max(size.width, size.height) / 32);
}

// 1 on the subject, 0 elsewhere.
core::Image subject_of(core::ImageView key, core::ImageView mask) {
  core::Image subject(key.height(), key.width(), 1);
  for (int y = 0; y < key.height(); ++y) {
    for (int x = 0; x < key.width(); ++x) subject(y, x) = mask.empty() || mask(y, x) > 0.5F ? 1.0F : 0.0F;
  }
  return subject;
}

// Half a cell along the subject's outline is not looked at: what a turning subject shows there, and the background that it uncovers,
// has no counterpart in the key frame. Where the subject leaves the picture there is no outline.
core::Image without_outline(const core::Image& mask) {
  const int side = 2 * (cell_side(mask.size()) / 2) + 1;
  core::Image inside = mask;
  const cv::Mat view(inside.height(), inside.width(), CV_32F, inside.values().data());
  cv::erode(view, view, cv::getStructuringElement(cv::MORPH_RECT, {side, side}));
  return inside;
}

// Root mean square difference by cells; cells with less than half of their pixels in the mask say nothing.
core::Image difference_by_cells(core::ImageView key, core::ImageView warped, core::ImageView mask) {
  const int cell = cell_side(key.size());
  const double white = white_level(core::to_luminance(key));
  const core::Image a = encoded_luminance(core::to_luminance(key), white);
  const core::Image b = encoded_luminance(core::to_luminance(warped), white);
  core::Image result((key.height() + cell - 1) / cell, (key.width() + cell - 1) / cell, 1);
  for (int cell_y = 0; cell_y < result.height(); ++cell_y) {
    for (int cell_x = 0; cell_x < result.width(); ++cell_x) {
      double sum = 0;
      int count = 0;
      for (int y = cell_y * cell; y < std::min(key.height(), (cell_y + 1) * cell); ++y) {
        for (int x = cell_x * cell; x < std::min(key.width(), (cell_x + 1) * cell); ++x) {
          if (mask(y, x) <= 0.5F) continue;
          // Highlights do not move with the surface.
          const double difference = std::min(1.0, double(a(y, x))) - std::min(1.0, double(b(y, x)));
          sum += difference * difference;
          ++count;
        }
      }
      if (2 * count >= cell * cell) result(cell_y, cell_x) = float(std::sqrt(sum / count));
    }
  }
  return result;
}

}  // namespace

Agreement agreement_of(core::ImageView key, core::ImageView picture, const FlowField& flow, core::ImageView confidence,
                       core::ImageView mask) {
  if (confidence.channels() != 1 || confidence.width() != key.width() || confidence.height() != key.height()) {
    throw core::BadInput("agreement with the key frame: the flow's confidence is of another size");
  }
  const core::Image warped = warp(picture, flow);
  Agreement agreement;
  // What left the picture is not known to differ.
  core::Image seen = subject_of(key, mask);
  core::Image inside = without_outline(seen);
  clear_outside(seen, flow);
  clear_outside(inside, flow);
  agreement.residual = residual(key, warped, seen);
  agreement.motion_px = median_motion_px(flow, mask);
  std::size_t subject = 0, believed = 0;
  for (int y = 0; y < key.height(); ++y) {
    for (int x = 0; x < key.width(); ++x) {
      if (!mask.empty() && mask(y, x) <= 0.5F) continue;
      ++subject;
      if (confidence(y, x) > 0) ++believed;
    }
  }
  if (subject > 0) agreement.believed = double(believed) / double(subject);
  agreement.difference = difference_by_cells(key, warped, inside);
  return agreement;
}

std::string key_objection(core::ImageView key, core::ImageView mask, double saturation) {
  constexpr double kLeastOverNoise = 4;
  constexpr double kLeastContrast = 0.02;  // of display-encoded values, between the 1st and 99th percentile
  constexpr double kMostSaturated = 0.5;   // of the subject
  constexpr double kClipping = 0.99;       // of the saturation: noise is left in what clips
  const core::Image luminance = core::to_luminance(key);
  // What is left of a black picture once a dark one is subtracted is as often negative as it is positive.
  if (!(core::quantile(luminance.values(), 0.99) >
        kLeastOverNoise * std::max(0.0, -core::quantile(luminance.values(), 0.01)))) {
    return "is black";
  }
  const core::Image encoded = encoded_luminance(luminance, white_level(luminance));
  if (core::quantile(encoded.values(), 0.99) - core::quantile(encoded.values(), 0.01) < kLeastContrast) {
    return "shows nothing to follow: it is even";
  }
  if (!(saturation > 0)) return {};
  std::size_t subject = 0, clipped = 0;
  for (int y = 0; y < key.height(); ++y) {
    for (int x = 0; x < key.width(); ++x) {
      if (!mask.empty() && mask(y, x) <= 0.5F) continue;
      ++subject;
      const float* pixel = key.pixel(y, x);
      clipped += double(*std::max_element(pixel, pixel + key.channels())) >= kClipping * saturation;
    }
  }
  const double share = subject == 0 ? 0 : double(clipped) / double(subject);
  return share > kMostSaturated ? "is saturated over " + rounded(100 * share) + " % of the subject" : std::string();
}

std::vector<std::string> objections(std::span<const Agreement> frames, int longer_side) {
  std::vector<std::string> result(frames.size());
  if (frames.empty()) return result;
  std::vector<double> residuals;
  for (const Agreement& frame : frames) residuals.push_back(frame.residual);
  const bool comparable = frames.size() >= kFewestToCompare;
  const double usual = median(residuals);
  // What each cell mostly differs by.
  std::vector<double> usual_in_cell(frames.front().difference.values().size());
  for (std::size_t i = 0; i < usual_in_cell.size(); ++i) {
    std::vector<double> values;
    for (const Agreement& frame : frames) values.push_back(double(frame.difference.values()[i]));
    usual_in_cell[i] = median(std::move(values));
  }
  const double farthest = std::max(kFarthestMotionPx, double(longer_side) / 64);
  for (std::size_t f = 0; f < frames.size(); ++f) {
    const Agreement& frame = frames[f];
    if (frame.motion_px > farthest) {
      result[f] =
          "moved " + rounded(frame.motion_px) + " px, farther than the " + rounded(farthest) + " px that can be undone";
    } else if (frame.believed < kLeastBelieved) {
      result[f] = "cannot be followed: only " + rounded(100 * frame.believed) + " % of the subject is found again";
    } else if (frame.residual > kMostOverall) {
      result[f] = "does not resemble the key frame";
    } else if (comparable) {
      std::size_t changed = 0, cells = 0;
      for (std::size_t i = 0; i < usual_in_cell.size(); ++i) {
        cells += usual_in_cell[i] > 0;
        changed += double(frame.difference.values()[i]) > std::max(kLeastInCell, kMostTimesInCell * usual_in_cell[i]);
      }
      const bool on_the_whole = frame.residual > std::max(kLeastOverall, kMostTimesOverall * usual);
      if (4 * changed > cells || (changed == 0 && on_the_whole)) {
        result[f] = "does not resemble the key frame";
      } else if (changed > 0) {
        result[f] = "changed in places, as by a blink or an expression";
      }
    }
  }
  return result;
}

}  // namespace lightstage::align
