#include "relight/harmonics.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>

#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"
#include "relight/environment.h"

namespace lightstage::relight {

namespace {

using Complex = std::complex<double>;

constexpr double kPi = std::numbers::pi;
constexpr int kChannels = 3;

struct Node {
  double position, weight;
};

// Gauss-Legendre nodes on [-1, 1], by Newton's method from Tricomi's first guess (Abramowitz and Stegun 25.4.29, 22.16.6).
std::vector<Node> gauss_legendre(int n) {
  std::vector<Node> nodes;
  for (int i = 0; i < n; ++i) {
    double x = std::cos(kPi * (i + 0.75) / (n + 0.5)), derivative = 1;
    for (int iteration = 0; iteration < 8; ++iteration) {
      double before = 1, value = x;
      for (int k = 2; k <= n; ++k) {
        const double next = ((2 * k - 1) * x * value - (k - 1) * before) / k;
        before = value;
        value = next;
      }
      derivative = n * (x * value - before) / (x * x - 1);
      x -= value / derivative;
    }
    nodes.push_back({x, 2 / ((1 - x * x) * derivative * derivative)});
  }
  return nodes;
}

// Means of the Legendre functions over the rows of a map, each over the row's area.
class RowMeans {
 public:
  // A Legendre function of degree l is a trigonometric polynomial of the colatitude, of degree l + 1 with the sine of the area. Over a row of angle
  // h, n nodes integrate it to about (l h / 4)^2n / (2n)!: to rounding by 4 and one more for each half radian of phase.
  RowMeans(int height, int degree) : degree_(degree) {
    const double row = kPi / height;
    const std::vector<Node> gauss = gauss_legendre(4 + int(std::ceil(row * (degree + 1))));
    nodes_per_row_ = gauss.size();
    for (int y = 0; y < height; ++y) {
      double area = 0;
      for (const Node& node : gauss) {
        const double colatitude = row * (y + 0.5 * (1 + node.position));
        const double sine = std::sin(colatitude);
        points_.push_back({std::cos(colatitude), sine, node.weight * sine});
        area += points_.back().weight;
      }
      for (std::size_t i = points_.size() - nodes_per_row_; i < points_.size(); ++i) points_[i].weight /= area;
    }
    double sectoral = std::sqrt(1 / (4 * kPi));
    for (int m = 0; m <= degree; ++m) {
      if (m > 0) sectoral *= std::sqrt((2 * m + 1.0) / (2 * m));
      sectoral_.push_back(sectoral);
      first_step_.push_back(steps_.size());
      for (int degree_l = m + 1; degree_l <= degree; ++degree_l) {
        const double l = degree_l, mm = double(m) * m;
        const double a = std::sqrt((4 * l * l - 1) / (l * l - mm));
        const double b = std::sqrt(((l - 1) * (l - 1) - mm) / (4 * (l - 1) * (l - 1) - 1));
        steps_.push_back({a, a * b});
      }
    }
  }

  // means[l - m] of N_lm P_lm over row y, for l = m .. degree. Upwards in l from the sectoral function, as in Holmes and Featherstone 2002, "A unified
  // approach to the Clenshaw summation and the recursive computation of very high degree and order normalised associated Legendre functions", equations
  // 11 to 13: each function is normalised, so that none grows beyond sqrt(l), and sin^m underflows only where all that follows from it is nothing.
  void fill(int y, int m, std::span<double> means) const {
    std::fill(means.begin(), means.end(), 0.0);
    const Step* const steps = steps_.data() + first_step_[std::size_t(m)];
    for (std::size_t i = std::size_t(y) * nodes_per_row_; i < (std::size_t(y) + 1) * nodes_per_row_; ++i) {
      const Point& point = points_[i];
      double before = 0, value = sectoral_[std::size_t(m)] * std::pow(point.sine, m);
      means[0] += point.weight * value;
      for (int k = 0; k < degree_ - m; ++k) {
        const double next = steps[k].up * point.cosine * value - steps[k].back * before;
        before = value;
        value = next;
        means[std::size_t(k) + 1] += point.weight * value;
      }
    }
  }

 private:
  struct Point {
    double cosine, sine, weight;  // of the colatitude; weights of a row sum to 1
  };
  struct Step {
    double up, back;  // P_l = up cos P_l-1 - back P_l-2
  };
  int degree_;
  std::size_t nodes_per_row_ = 0;
  std::vector<Point> points_;            // row by row
  std::vector<double> sectoral_;         // N_mm P_mm / sin^m
  std::vector<Step> steps_;              // of every m in turn
  std::vector<std::size_t> first_step_;  // of m
};

// What a row's Fourier transform and the longitudes of its pixels have to do with each other.
class RowPhases {
 public:
  RowPhases(int width, int degree) : width_(width) {
    for (std::int64_t m = 0; m <= degree; ++m) {
      // Longitudes fall from pi (W - 1) / W by 2 pi / W a pixel; whole turns are taken off before they cost digits.
      const double phase = kPi * double(m * (width - 1) % (2 * std::int64_t(width))) / width;
      const double half_pixel = kPi * double(m) / width;
      // A pixel is as wide as its column: the mean of cos(m longitude) over it is this much of the value at its centre.
      const double mean = m == 0 ? 1 : m % width == 0 ? 0 : std::sin(half_pixel) / half_pixel;
      factors_.push_back((m == 0 ? 1 : std::numbers::sqrt2) * mean * std::polar(1.0, phase));
    }
  }

  // e^(i m longitude of the first pixel), times the mean over a pixel, times the sqrt(2) of harmonics with m > 0.
  Complex factor(int m) const { return factors_[std::size_t(m)]; }
  // Where e^(-2 pi i m x / W) and its conjugate are in the transform.
  int bin(int m) const { return m % width_; }
  int opposite_bin(int m) const { return (width_ - m % width_) % width_; }

 private:
  int width_;
  std::vector<Complex> factors_;
};

void require_weights(std::span<const double> weights, std::size_t count) {
  if (weights.size() != count)
    throw core::UsageError("a filter of spherical harmonics needs " + std::to_string(count) + " weights, not " +
                           std::to_string(weights.size()));
}

}  // namespace

Harmonics::Harmonics(core::ImageView map, int degree) : degree_(degree) {
  if (degree < 0 || degree > kMaxDegree)
    throw core::UsageError("spherical harmonics go from degree 0 to " + std::to_string(kMaxDegree) + ", not to " +
                           std::to_string(degree));
  if (map.empty()) throw core::BadInput("an environment map needs at least one pixel");
  core::require_finite(map, "an environment map");
  const int height = map.height(), width = map.width();
  const std::size_t orders = std::size_t(degree) + 1;
  const RowPhases phases(width, degree);

  // First along the rows: spectra[y][m][channel] is the integral over the row of radiance times sqrt(2) e^(i m longitude).
  std::vector<Complex> spectra(std::size_t(height) * orders * kChannels);
  core::parallel_for(std::size_t(height), 16, [&](std::size_t first, std::size_t last) {
    cv::Mat row(kChannels, width, CV_64F), transform;
    for (std::size_t y = first; y < last; ++y) {
      const float* pixel = map.row(int(y));
      for (int x = 0; x < width; ++x, pixel += map.channels())
        for (int c = 0; c < kChannels; ++c) row.at<double>(c, x) = double(pixel[map.channels() < 3 ? 0 : c]);
      cv::dft(row, transform, cv::DFT_ROWS | cv::DFT_COMPLEX_OUTPUT);
      Complex* spectrum = spectra.data() + y * orders * kChannels;
      for (int m = 0; m <= degree; ++m)
        for (int c = 0; c < kChannels; ++c) *spectrum++ = phases.factor(m) * transform.at<Complex>(c, phases.bin(m));
    }
  });

  // Then along the meridians, each order m apart from the others and in the order of the rows.
  coefficients_.resize(orders * orders);
  const RowMeans means(height, degree);
  core::parallel_for(orders, 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t m = first; m < last; ++m) {
      std::vector<double> legendre(orders - m);
      for (int y = 0; y < height; ++y) {
        means.fill(y, int(m), legendre);
        const double solid_angle = Environment::solid_angle(y, height, width);
        const Complex* f = spectra.data() + (std::size_t(y) * orders + m) * kChannels;
        const core::Vec3 cosines = solid_angle * core::Vec3{f[0].real(), f[1].real(), f[2].real()};
        const core::Vec3 sines = solid_angle * core::Vec3{f[0].imag(), f[1].imag(), f[2].imag()};
        for (std::size_t l = m; l < orders; ++l) {
          core::Vec3* middle = coefficients_.data() + l * l + l;
          middle[m] = middle[m] + legendre[l - m] * cosines;
          if (m > 0) *(middle - m) = *(middle - m) + legendre[l - m] * sines;
        }
      }
    }
  });
}

std::vector<double> Harmonics::energy_by_degree() const {
  std::vector<double> energy;
  for (int l = 0; l <= degree_; ++l) {
    double sum = 0;
    for (int m = -l; m <= l; ++m) {
      const core::Vec3 c = coefficient(l, m);
      sum += core::dot(c, c);
    }
    energy.push_back(sum);
  }
  return energy;
}

core::Image Harmonics::map(int height, int width, std::span<const double> weight_of_degree) const {
  if (height < 1 || width < 1)
    throw core::UsageError("a map needs at least 1x1 pixels, not " + std::to_string(width) + "x" +
                           std::to_string(height));
  require_weights(weight_of_degree, std::size_t(degree_) + 1);
  core::Image map(height, width, kChannels);
  const RowMeans means(height, degree_);
  const RowPhases phases(width, degree_);
  core::parallel_for(std::size_t(height), 16, [&](std::size_t first, std::size_t last) {
    cv::Mat spectrum(kChannels, width, CV_64FC2), row;
    std::vector<double> legendre(std::size_t(degree_) + 1);
    for (int y = int(first); y < int(last); ++y) {
      spectrum.setTo(0);
      for (int m = 0; m <= degree_; ++m) {
        means.fill(y, m, std::span(legendre).first(std::size_t(degree_ - m) + 1));
        core::Vec3 cosine, sine;
        for (int l = m; l <= degree_; ++l) {
          const double weight = weight_of_degree[std::size_t(l)] * legendre[std::size_t(l - m)];
          cosine = cosine + weight * coefficient(l, m);
          if (m > 0) sine = sine + weight * coefficient(l, -m);
        }
        // a cos + b sin is the real part of (a + i b) e^(-i m longitude): half there, half conjugate at the opposite frequency.
        const Complex half = 0.5 * std::conj(phases.factor(m));
        const Complex channels[] = {{cosine.x, sine.x}, {cosine.y, sine.y}, {cosine.z, sine.z}};
        for (int c = 0; c < kChannels; ++c) {
          spectrum.at<Complex>(c, phases.bin(m)) += half * channels[c];
          spectrum.at<Complex>(c, phases.opposite_bin(m)) += std::conj(half * channels[c]);
        }
      }
      cv::dft(spectrum, row, cv::DFT_ROWS | cv::DFT_INVERSE | cv::DFT_REAL_OUTPUT);
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < kChannels; ++c) map(y, x, c) = float(row.at<double>(c, x));
    }
  });
  return map;
}

core::Image filtered(core::ImageView map, std::span<const double> weight_of_degree) {
  const Harmonics harmonics(map, int(weight_of_degree.size()) - 1);
  return harmonics.map(map.height(), map.width(), weight_of_degree);
}

std::vector<double> cutoff_weights(int last_whole, int first_gone) {
  if (last_whole < 0 || first_gone <= last_whole || first_gone > Harmonics::kMaxDegree + 1)
    throw core::UsageError(
        "a cut-off needs 0 <= last whole degree < first one gone <= " + std::to_string(Harmonics::kMaxDegree + 1) +
        ", not " + std::to_string(last_whole) + " and " + std::to_string(first_gone));
  std::vector<double> weights;
  for (int l = 0; l < first_gone; ++l) {
    const double along = double(std::max(0, l - last_whole)) / (first_gone - last_whole);
    weights.push_back(0.5 * (1 + std::cos(kPi * along)));
  }
  return weights;
}

std::vector<double> blur_weights(double sigma_radians) {
  constexpr double kLeast = 1e-9;
  std::vector<double> weights;
  if (std::isfinite(sigma_radians) && sigma_radians > 0) {
    for (int l = 0; l <= Harmonics::kMaxDegree; ++l) {
      weights.push_back(std::exp(-double(l) * (l + 1) * sigma_radians * sigma_radians / 2));
      if (weights.back() < kLeast) return weights;
    }
  }
  throw core::UsageError("a blur of an environment needs a finite sigma of at least 0.37 degrees, not " +
                         std::to_string(sigma_radians * 180 / kPi) + " degrees");
}

}  // namespace lightstage::relight
