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

// A query, and what everybody shows for it, as judged.
struct Shown {
  std::size_t at = 0;  // in MethodScore::each
  core::Direction query;
  core::OlatScan known;
  core::Image truth;
  std::vector<core::Image> pictures;  // a method each
};

core::Image as_judged(const core::Image& linear, const Shown& shown, bool linear_values) {
  return core::to_rgb(model::judged(linear, shown.known.exposure(), linear_values));
}

CropSheet sheet_of(const JudgedStage& stage, const Shown& shown) {
  const core::Image& truth = shown.truth;
  const int shorter = std::min(truth.height(), truth.width()), side = std::min(shorter, std::max(32, shorter / 3));
  const cv::Rect frame = largest_square(spread_map(shown.pictures, truth, shown.known.mask()), side);
  const core::Image truth_crop = cut(truth, frame);
  std::vector<std::vector<SheetCell>> rows;
  for (std::size_t first = 0; first < shown.pictures.size(); first += kMethodsARow) {
    std::vector<SheetCell> crops{{truth_crop, "truth"}}, errors{{with_frame(truth, frame), "truth, whole"}};
    for (std::size_t m = first; m < std::min(first + kMethodsARow, shown.pictures.size()); ++m) {
      const core::Image crop = cut(shown.pictures[m], frame);
      const model::MethodScore& score = stage.scores[m];
      crops.push_back({crop, score.name});
      errors.push_back(
          {difference_picture(crop, truth_crop, kErrorGain),
           "x" + fixed(kErrorGain, 0) + ", RMSE " + fixed(std::sqrt(score.each[shown.at].mean_squared_error), 4)});
    }
    rows.push_back(std::move(crops));
    rows.push_back(std::move(errors));
  }
  return {contact_sheet(rows, side * std::max(1, kLargestCell / side)),
          "light at " + fixed(shown.query.longitude_degrees(), 0) + ", " + fixed(shown.query.latitude_degrees(), 0) +
              " degrees, " + fixed(stage.scores.front().each[shown.at].degrees_to_light, 1) +
              " degrees from the nearest that the methods had; errors " + fixed(kErrorGain, 0) + " times enlarged"};
}

}  // namespace

std::vector<CropSheet> crops_where_methods_differ(const JudgedStage& stage, bool linear_values, std::size_t count) {
  if (stage.scores.empty() || stage.scores.front().each.empty()) return {};
  std::vector<Shown> queries;
  for (const std::size_t i : queries_by_spread(stage.scores)) {
    if (queries.size() == count) break;
    const std::size_t index = stage.scores.front().each[i].index;
    Shown shown{i, stage.protocol.query(index), stage.protocol.known(index), {}, {}};
    shown.truth = as_judged(stage.protocol.truth(index), shown, linear_values);
    queries.push_back(std::move(shown));
  }
  for (const MethodChoice& choice : stage.choices) {
    std::unique_ptr<model::LightInterpolator> method;
    for (Shown& shown : queries) {
      core::throw_if_interrupted();
      const bool fitted = method && stage.protocol.one_scan;
      if (!fitted) method = model::make_interpolator(choice.method, shown.known, choice.options);
      shown.pictures.push_back(as_judged(method->render(shown.query), shown, linear_values));
    }
  }
  std::vector<CropSheet> sheets;
  for (const Shown& shown : queries) sheets.push_back(sheet_of(stage, shown));
  return sheets;
}

}  // namespace lightstage::cli
