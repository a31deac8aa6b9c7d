#include "model/classical/linear_terms.h"

#include <numeric>
#include <opencv2/core.hpp>

namespace lightstage::model {

namespace {

constexpr double kFlat = 1e-2;  // spread relative to the widest axis

}  // namespace

LinearTerms::LinearTerms(std::span<const core::Vec3> points) {
  const int n = static_cast<int>(points.size());
  centre_ = std::accumulate(points.begin(), points.end(), core::Vec3{}) / double(n);
  cv::Mat spread(n, 3, CV_64F);
  for (int i = 0; i < n; ++i) {
    const core::Vec3 d = points[std::size_t(i)] - centre_;
    spread.at<double>(i, 0) = d.x;
    spread.at<double>(i, 1) = d.y;
    spread.at<double>(i, 2) = d.z;
  }
  const cv::SVD principal(spread);
  const double widest = principal.w.at<double>(0);
  for (int k = 0; k < principal.w.rows; ++k) {
    if (!(principal.w.at<double>(k) > kFlat * widest)) break;
    const double* axis = principal.vt.ptr<double>(k);
    axes_.push_back({axis[0], axis[1], axis[2]});
  }
}

std::vector<double> LinearTerms::at(core::Vec3 place) const {
  std::vector<double> terms{1};
  for (const core::Vec3 axis : axes_) terms.push_back(core::dot(axis, place - centre_));
  return terms;
}

}  // namespace lightstage::model
