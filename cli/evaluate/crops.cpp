#include "cli/evaluate/crops.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "cli/format.h"
#include "cli/report/contact_sheet.h"
#include "core/interrupt.h"

namespace lightstage::cli {

namespace {

constexpr double kErrorGain = 4;
constexpr int kLargestCell = 240;  // pixels of a sheet; crops are enlarged by a whole number
constexpr std::size_t kMethodsARow = 5;

// Indices into MethodScore::each, the one with the widest spread of errors first.
std::vector<std::size_t> queries_by_spread(const std::vector<model::MethodScore>& scores) {
  std::vector<std::pair<double, std::size_t>> spreads;
  for (std::size_t i = 0; i < scores.front().each.size(); ++i) {
    double lowest = scores.front().each[i].mean_squared_error, highest = lowest;
    for (const model::MethodScore& score : scores) {
      lowest = std::min(lowest, score.each.at(i).mean_squared_error);
      highest = std::max(highest, score.each.at(i).mean_squared_error);
    }
    spreads.emplace_back(lowest - highest, i);
  }
  std::sort(spreads.begin(), spreads.end());
  std::vector<std::size_t> order;
  for (const auto& [spread, i] : spreads) order.push_back(i);
  return order;
}

// How far apart the squared errors of the pictures are at each pixel; 0 outside the mask.
cv::Mat spread_map(const std::vector<core::Image>& pictures, const core::Image& truth, const core::Image& mask) {
  cv::Mat map(truth.height(), truth.width(), CV_64F, 0.0);
  for (int y = 0; y < truth.height(); ++y) {
    for (int x = 0; x < truth.width(); ++x) {
      if (mask(y, x) <= 0.5f) continue;
      double lowest = INFINITY, highest = 0;
      for (const core::Image& picture : pictures) {
        double squares = 0;
        for (int c = 0; c < 3; ++c) squares += std::pow(double(picture(y, x, c)) - double(truth(y, x, c)), 2);
        lowest = std::min(lowest, squares);
        highest = std::max(highest, squares);
      }
      map.at<double>(y, x) = highest - lowest;
    }
  }
  return map;
}

// The square of `side` pixels with the largest sum.
cv::Rect largest_square(const cv::Mat& map, int side) {
  cv::Mat sums;
  cv::integral(map, sums, CV_64F);
  cv::Rect best(0, 0, side, side);
  double largest = -1;
  for (int y = 0; y + side <= map.rows; ++y) {
    for (int x = 0; x + side <= map.cols; ++x) {
      const double sum = sums.at<double>(y + side, x + side) - sums.at<double>(y, x + side) -
                         sums.at<double>(y + side, x) + sums.at<double>(y, x);
      if (sum > largest) {
        largest = sum;
        best.x = x;
        best.y = y;
      }
    }
  }
  return best;
}

core::Image with_frame(core::Image picture, const cv::Rect& frame) {
  const auto mark = [&](int y, int x) {
    picture(y, x, 0) = 1;
    picture(y, x, 1) = 0.75f;
    picture(y, x, 2) = 0;
  };
  for (int i = 0; i < frame.width; ++i) {
    mark(frame.y, frame.x + i);
    mark(frame.y + frame.height - 1, frame.x + i);
    mark(frame.y + i, frame.x);
    mark(frame.y + i, frame.x + frame.width - 1);
  }
  return picture;
}

core::Image cut(const core::Image& picture, const cv::Rect& frame) {
  return core::Image(picture.view().crop(frame.y, frame.x, frame.height, frame.width));
}

}  // namespace

std::vector<CropSheet> crops_where_methods_differ(const JudgedStage& stage, bool linear_values, std::size_t count) {
  std::vector<CropSheet> sheets;
  if (stage.scores.empty() || stage.scores.front().each.empty()) return sheets;
  for (const std::size_t i : queries_by_spread(stage.scores)) {
    if (sheets.size() == count) break;
    const std::size_t index = stage.scores.front().each[i].index;
    const core::OlatScan known = stage.protocol.known(index);
    const core::Direction query = stage.protocol.query(index);
    const auto shown = [&](const core::Image& linear) {
      return core::to_rgb(model::judged(linear, known.exposure(), linear_values));
    };
    const core::Image truth = shown(stage.protocol.truth(index));
    std::vector<core::Image> pictures;
    for (const MethodChoice& choice : stage.choices) {
      core::throw_if_interrupted();
      pictures.push_back(shown(model::make_interpolator(choice.method, known, choice.options)->render(query)));
    }
    const int shorter = std::min(truth.height(), truth.width()), side = std::min(shorter, std::max(32, shorter / 3));
    const cv::Rect frame = largest_square(spread_map(pictures, truth, known.mask()), side);
    const core::Image truth_crop = cut(truth, frame);
    std::vector<std::vector<SheetCell>> rows;
    for (std::size_t first = 0; first < pictures.size(); first += kMethodsARow) {
      std::vector<SheetCell> crops{{truth_crop, "truth"}}, errors{{with_frame(truth, frame), "truth, whole"}};
      for (std::size_t m = first; m < std::min(first + kMethodsARow, pictures.size()); ++m) {
        const core::Image crop = cut(pictures[m], frame);
        const model::MethodScore& score = stage.scores[m];
        crops.push_back({crop, score.name});
        errors.push_back(
            {difference_picture(crop, truth_crop, kErrorGain),
             "x" + fixed(kErrorGain, 0) + ", RMSE " + fixed(std::sqrt(score.each[i].mean_squared_error), 4)});
      }
      rows.push_back(std::move(crops));
      rows.push_back(std::move(errors));
    }
    sheets.push_back({contact_sheet(rows, side * std::max(1, kLargestCell / side)),
                      "light at " + fixed(query.longitude_degrees(), 0) + ", " + fixed(query.latitude_degrees(), 0) +
                          " degrees, " + fixed(stage.scores.front().each[i].degrees_to_light, 1) +
                          " degrees from the nearest that the methods had; errors " + fixed(kErrorGain, 0) +
                          " times enlarged"});
  }
  return sheets;
}

}  // namespace lightstage::cli
