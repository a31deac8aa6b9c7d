#include "cli/bench/simple_spots.h"

#include <opencv2/imgproc.hpp>

namespace lightstage::cli {

namespace {

constexpr double kPlainSigmaPx = 1.0 / 3;

}  // namespace

std::string_view name_of(SpotMethod method) {
  switch (method) {
    case SpotMethod::kFit:
      return "fit";
    case SpotMethod::kCentroid:
      return "centroid";
    case SpotMethod::kBrightest:
      return "brightest";
  }
  return "";
}

std::optional<calib::Highlight> find_spot(SpotMethod method, core::ImageView picture, const core::CameraModel& camera,
                                          const calib::Sphere& ball, double saturation) {
  if (method == SpotMethod::kFit) return calib::find_highlight(picture, camera, ball, saturation);
  const core::Image grey = core::to_luminance(picture);
  const auto on_ball = [&](int y, int x) {
    return calib::reflect_at(camera, ball, {double(x), double(y)}).has_value();
  };
  calib::Highlight spot;
  spot.sigma_px = kPlainSigmaPx;
  for (int y = 0; y < grey.height(); ++y) {
    for (int x = 0; x < grey.width(); ++x) {
      if (double(grey(y, x)) > spot.peak && on_ball(y, x)) spot.peak = grey(y, x);
    }
  }
  if (!(spot.peak > 0)) return std::nullopt;
  const bool all_alike = method == SpotMethod::kBrightest;
  cv::Mat_<uchar> bright = cv::Mat_<uchar>::zeros(grey.height(), grey.width());
  for (int y = 0; y < grey.height(); ++y) {
    for (int x = 0; x < grey.width(); ++x) {
      const double value = grey(y, x);
      if ((all_alike ? value == spot.peak : value > 0.5 * spot.peak) && on_ball(y, x)) bright(y, x) = 255;
    }
  }
  if (all_alike) {
    const cv::Moments moments = cv::moments(bright, true);
    spot.position = {moments.m10 / moments.m00, moments.m01 / moments.m00};
    return spot;
  }
  cv::Mat labels, sizes, centroids;
  const int parts = cv::connectedComponentsWithStats(bright, labels, sizes, centroids, 8);
  int largest = 1;
  for (int part = 2; part < parts; ++part) {
    if (sizes.at<int>(part, cv::CC_STAT_AREA) > sizes.at<int>(largest, cv::CC_STAT_AREA)) largest = part;
  }
  spot.position = {centroids.at<double>(largest, 0), centroids.at<double>(largest, 1)};
  return spot;
}

}  // namespace lightstage::cli
