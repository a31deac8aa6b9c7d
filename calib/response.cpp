#include "calib/response.h"

#include <opencv2/photo.hpp>
#include <set>

#include "core/error.h"
#include "core/image_file.h"

namespace lightstage::calib {

namespace {

constexpr int kCodes = 256;

void check(std::span<const ExposedPicture> pictures) {
  std::set<double> times;
  std::set<int> codes;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const std::string what = "response: picture " + std::to_string(i);
    const core::ImageView picture = pictures[i].picture;
    if (!(pictures[i].seconds > 0) || !std::isfinite(pictures[i].seconds)) {
      throw core::BadInput(what + ": its exposure time must be positive");
    }
    if (picture.size() != pictures.front().picture.size()) {
      throw core::BadInput(what + " is of another size than picture 0");
    }
    if (picture.empty() || (picture.channels() != 1 && picture.channels() != 3)) {
      throw core::BadInput(what + " must have 1 or 3 channels");
    }
    core::require_finite(picture, what);
    for (int y = 0; y < picture.height(); ++y) {
      for (int x = 0; x < picture.width() * picture.channels(); ++x) {
        const float v = picture.row(y)[x];
        if (v < 0 || v > 1) throw core::BadInput(what + " has values outside 0 to 1: it is no 8-bit picture");
        codes.insert(int(std::lround(v * 255)));
      }
    }
    times.insert(pictures[i].seconds);
  }
  if (times.size() < 2) throw core::BadInput("response: two different exposure times are needed at least");
  if (codes.size() < 20) {
    throw core::BadInput("response: the pictures show only " + std::to_string(codes.size()) +
                         " different codes; take a scene with bright and dark parts, exposed from dark to clipping");
  }
}

cv::Mat to_codes(core::ImageView picture) {
  cv::Mat codes(picture.height(), picture.width(), CV_8UC3);
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = 0; x < picture.width(); ++x) {
      auto& out = codes.at<cv::Vec3b>(y, x);
      for (int c = 0; c < 3; ++c) {
        out[c] = cv::saturate_cast<uchar>(picture(y, x, picture.channels() == 3 ? c : 0) * 255);
      }
    }
  }
  return codes;
}

// The nearest rising sequence by least squares: neighbours that fall are pooled (Ayer et al. 1955, "An empirical distribution function for sampling
// with incomplete information").
std::vector<double> rising(const std::vector<double>& values) {
  struct Pool {
    double sum = 0;
    int count = 0;
    double mean() const { return sum / count; }
  };
  std::vector<Pool> pools;
  for (const double v : values) {
    pools.push_back({v, 1});
    while (pools.size() > 1 && pools[pools.size() - 2].mean() > pools.back().mean()) {
      pools[pools.size() - 2].sum += pools.back().sum;
      pools[pools.size() - 2].count += pools.back().count;
      pools.pop_back();
    }
  }
  std::vector<double> result;
  for (const Pool& pool : pools) result.insert(result.end(), std::size_t(pool.count), pool.mean());
  return result;
}

// The ends show clipping and single codes rather than the scene: they are continued from what lies next to them by the power that holds there.
void continue_ends(std::vector<double>& curve) {
  constexpr std::size_t kDark = 12, kFromDark = 24, kBright = 240, kFromBright = 200;
  const auto power = [&](std::size_t a, std::size_t b) {
    return std::max(0.1, std::log(curve[b] / curve[a]) / std::log(double(b) / double(a)));
  };
  if (curve[kDark] > 0) {
    const double p = power(kDark, kFromDark);
    for (std::size_t k = 0; k < kDark; ++k) curve[k] = curve[kDark] * std::pow(double(k) / kDark, p);
  }
  const double p = power(kFromBright, kBright);
  for (std::size_t k = kBright + 1; k < curve.size(); ++k) {
    curve[k] = curve[kBright] * std::pow(double(k) / kBright, p);
  }
}

double residual_of(std::span<const ExposedPicture> pictures, const CameraResponse& response) {
  constexpr int kLow = 20, kHigh = 235;
  double squares = 0;
  std::size_t count = 0;
  const core::ImageSize size = pictures.front().picture.size();
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width * size.channels; ++x) {
      double sum = 0, sum_squares = 0;
      int n = 0;
      for (const ExposedPicture& p : pictures) {
        const int code = int(std::lround(p.picture.row(y)[x] * 255));
        if (code < kLow || code > kHigh) continue;
        const double light = response.curve[std::size_t(x % size.channels)][std::size_t(code)];
        const double v = std::log(light / p.seconds);
        sum += v;
        sum_squares += v * v;
        ++n;
      }
      if (n < 2) continue;
      squares += std::max(0.0, sum_squares - sum * sum / n);
      count += std::size_t(n - 1);
    }
  }
  return count > 0 ? std::sqrt(squares / double(count)) : 0;
}

}  // namespace

CameraResponse estimate_response(std::span<const ExposedPicture> pictures, ResponseMethod method) {
  check(pictures);
  std::vector<cv::Mat> codes;
  std::vector<float> times;
  for (const ExposedPicture& p : pictures) {
    codes.push_back(to_codes(p.picture));
    times.push_back(float(p.seconds));
  }
  cv::Mat found;
  if (method == ResponseMethod::kDebevec) {
    constexpr int kSamples = 150;
    constexpr float kSmoothness = 20;
    cv::createCalibrateDebevec(kSamples, kSmoothness, false)->process(codes, found, times);
  } else {
    cv::createCalibrateRobertson(50, 0.001F)->process(codes, found, times);
  }
  CameraResponse response;
  double largest = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    std::vector<double> curve;
    for (int k = 0; k < kCodes; ++k) curve.push_back(double(found.at<cv::Vec3f>(k, 0)[int(c)]));
    response.curve[c] = rising(curve);
    const double middle = response.curve[c][128];
    if (!(response.curve[c][24] > 0) || !std::isfinite(response.curve[c][240])) {
      throw core::BadInput("response: it could not be recovered; take more exposures of a scene with more shades");
    }
    for (double& v : response.curve[c]) v = std::max(0.0, v / middle);
    continue_ends(response.curve[c]);
    largest = std::max(largest, response.curve[c].back());
  }
  for (std::vector<double>& curve : response.curve) {
    for (double& v : curve) v /= largest;
  }
  response.residual = residual_of(pictures, response);
  return response;
}

core::Image exposure_of(core::ImageView codes, const CameraResponse& response) {
  if (codes.channels() != 1 && codes.channels() != 3) {
    throw core::BadInput("response: the picture must have 1 or 3 channels");
  }
  core::Image light(codes.size());
  for (int y = 0; y < codes.height(); ++y) {
    for (int x = 0; x < codes.width() * codes.channels(); ++x) {
      const std::vector<double>& curve = response.curve[std::size_t(x % codes.channels())];
      const double code = std::clamp(double(codes.row(y)[x]), 0.0, 1.0) * (kCodes - 1);
      const auto below = std::min(std::size_t(code), std::size_t(kCodes - 2));
      const double share = code - double(below);
      light.pixel(y, 0)[x] = float((1 - share) * curve[below] + share * curve[below + 1]);
    }
  }
  return light;
}

}  // namespace lightstage::calib
