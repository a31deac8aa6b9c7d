#include "cli/report/contact_sheet.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

namespace lightstage::cli {

namespace {

constexpr int kMargin = 6;
constexpr int kCaptionHeight = 18;

// A copy as OpenCV holds it; channels stay RGB, since nothing here is shown by OpenCV itself.
cv::Mat to_mat(const core::Image& image) {
  cv::Mat mat(image.height(), image.width(), CV_32FC3);
  std::copy(image.values().begin(), image.values().end(), mat.ptr<float>());
  return mat;
}

cv::Mat fitted(const core::Image& picture, int largest) {
  cv::Mat mat = to_mat(core::to_rgb(picture));
  const double scale = double(largest) / std::max(mat.rows, mat.cols);
  if (scale < 1) cv::resize(mat, mat, {}, scale, scale, cv::INTER_AREA);
  if (scale >= 2) cv::resize(mat, mat, {}, std::floor(scale), std::floor(scale), cv::INTER_NEAREST);
  return mat;
}

}  // namespace

core::Image contact_sheet(const std::vector<std::vector<SheetCell>>& rows, int largest) {
  std::size_t columns = 0;
  int cell_width = 1, cell_height = 1;
  std::vector<std::vector<cv::Mat>> pictures;
  for (const auto& row : rows) {
    columns = std::max(columns, row.size());
    auto& fitted_row = pictures.emplace_back();
    for (const SheetCell& cell : row) {
      fitted_row.push_back(fitted(cell.picture, largest));
      cell_width = std::max(cell_width, fitted_row.back().cols);
      cell_height = std::max(cell_height, fitted_row.back().rows);
    }
  }
  const int step_x = cell_width + kMargin;
  const int step_y = cell_height + kCaptionHeight + kMargin;
  cv::Mat sheet(int(rows.size()) * step_y + kMargin, int(columns) * step_x + kMargin, CV_32FC3, cv::Scalar::all(0.12));
  for (std::size_t r = 0; r < rows.size(); ++r) {
    for (std::size_t c = 0; c < rows[r].size(); ++c) {
      const cv::Mat& picture = pictures[r][c];
      const int x = kMargin + int(c) * step_x;
      const int y = kMargin + int(r) * step_y;
      picture.copyTo(sheet(cv::Rect(x, y, picture.cols, picture.rows)));
      cv::putText(sheet, rows[r][c].caption, {x, y + cell_height + kCaptionHeight - 5}, cv::FONT_HERSHEY_SIMPLEX, 0.4,
                  cv::Scalar::all(0.95), 1, cv::LINE_AA);
    }
  }
  core::Image image(sheet.rows, sheet.cols, 3);
  std::copy(sheet.ptr<float>(), sheet.ptr<float>() + sheet.total() * 3, image.values().begin());
  return image;
}

core::Image difference_picture(core::ImageView a, core::ImageView b, double gain) {
  core::Image picture(a.height(), a.width(), 3);
  for (int y = 0; y < a.height(); ++y) {
    for (int x = 0; x < a.width(); ++x) {
      double sum = 0;
      for (int c = 0; c < a.channels(); ++c) sum += std::abs(double(a(y, x, c)) - double(b(y, x, c)));
      const double heat = 3 * gain * sum / a.channels();
      for (int c = 0; c < 3; ++c) picture(y, x, c) = float(std::clamp(heat - c, 0.0, 1.0));
    }
  }
  return picture;
}

}  // namespace lightstage::cli
