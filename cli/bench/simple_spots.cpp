#include "cli/bench/simple_spots.h"

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
      if (!(double(grey(y, x)) > spot.peak) || !on_ball(y, x)) continue;
      spot.peak = grey(y, x);
      spot.position = {double(x), double(y)};
    }
  }
  if (!(spot.peak > 0)) return std::nullopt;
  if (method == SpotMethod::kBrightest) return spot;
  double sum_x = 0, sum_y = 0;
  int count = 0;
  for (int y = 0; y < grey.height(); ++y) {
    for (int x = 0; x < grey.width(); ++x) {
      if (!(double(grey(y, x)) > 0.5 * spot.peak) || !on_ball(y, x)) continue;
      sum_x += x;
      sum_y += y;
      ++count;
    }
  }
  spot.position = {sum_x / count, sum_y / count};
  return spot;
}

}  // namespace lightstage::cli
