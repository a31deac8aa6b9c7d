#include "calib/colour_chart.h"

#include <Eigen/Dense>
#include <opencv2/imgproc.hpp>
#include <opencv2/mcc.hpp>

#include "calib/colour/lab.h"
#include "calib/robust/quantile.h"
#include "core/display.h"
#include "core/error.h"
#include "core/image_file.h"

namespace lightstage::calib {

namespace {

constexpr int kColumns = 6, kRows = 4, kPatches = kColumns * kRows;
constexpr int kFirstGrey = 18;
constexpr double kClipped = 0.97;       // of saturation
constexpr double kClippedShare = 0.02;  // of a patch's pixels
constexpr std::size_t kLeastPatches = 12, kLeastGrey = 2;

struct Reference {
  const char* name;
  Triple lab;
};

// L*a*b* under D50, as X-Rite published it for charts made before November 2014 (later ones differ by less than 2 CIEDE2000 in most patches).
constexpr std::array<Reference, kPatches> kReference{{
    {"dark skin", {37.986, 13.555, 14.059}},     {"light skin", {65.711, 18.130, 17.810}},
    {"blue sky", {49.927, -4.880, -21.925}},     {"foliage", {43.139, -13.095, 21.905}},
    {"blue flower", {55.112, 8.844, -25.399}},   {"bluish green", {70.719, -33.397, -0.199}},
    {"orange", {62.661, 36.067, 57.096}},        {"purplish blue", {40.020, 10.410, -45.964}},
    {"moderate red", {51.124, 48.239, 16.248}},  {"purple", {30.325, 22.976, -21.587}},
    {"yellow green", {72.532, -23.709, 57.255}}, {"orange yellow", {71.941, 19.363, 67.857}},
    {"blue", {28.778, 14.179, -50.297}},         {"green", {55.261, -38.342, 31.370}},
    {"red", {42.101, 53.378, 28.190}},           {"yellow", {81.733, 4.039, 79.819}},
    {"magenta", {51.935, 49.986, -14.574}},      {"cyan", {51.038, -28.631, -28.638}},
    {"white", {96.539, -0.425, 1.186}},          {"neutral 8", {81.257, -0.638, -0.335}},
    {"neutral 6.5", {66.766, -0.734, -0.504}},   {"neutral 5", {50.867, -0.153, -0.270}},
    {"neutral 3.5", {35.656, -0.421, -1.231}},   {"black", {20.461, -0.079, -0.973}},
}};

// For the detector: 8 bits, blue first, exposed so that little clips.
cv::Mat for_detector(core::ImageView picture) {
  std::vector<double> values;
  for (int y = 0; y < picture.height(); y += 2) {
    for (int x = 0; x < picture.width(); x += 2) {
      values.push_back(double(*std::max_element(picture.pixel(y, x), picture.pixel(y, x) + 3)));
    }
  }
  constexpr double kBright = 0.995;
  const double scale = 1 / std::max(quantile(values, kBright), 1e-12);
  cv::Mat shown(picture.height(), picture.width(), CV_8UC3);
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = 0; x < picture.width(); ++x) {
      for (int c = 0; c < 3; ++c) {
        const float linear = std::clamp(float(double(picture(y, x, c)) * scale), 0.0F, 1.0F);
        shown.at<cv::Vec3b>(y, x)[2 - c] = cv::saturate_cast<uchar>(255 * core::srgb_encode(linear));
      }
    }
  }
  return shown;
}

using Corners = std::array<core::Pixel, 4>;

Corners detect(core::ImageView picture) {
  const cv::Ptr<cv::mcc::CCheckerDetector> detector = cv::mcc::CCheckerDetector::create();
  const cv::Mat shown = for_detector(picture);
  if (!detector->process(shown, cv::mcc::MCC24, 1) || detector->getBestColorChecker() == nullptr) {
    throw core::BadInput(
        "no colour chart of 24 patches was found: it must lie flat, be evenly lit and 60 pixels wide at least; or say "
        "where "
        "its corners are");
  }
  const std::vector<cv::Point2f> box = detector->getBestColorChecker()->getBox();
  Corners corners;
  for (std::size_t i = 0; i < 4; ++i) corners[i] = {double(box[i].x), double(box[i].y)};
  return corners;
}

// Places on the chart, in units of patches, to pixels.
Eigen::Matrix3d picture_from_chart(const Corners& corners) {
  const cv::Point2f chart[] = {{0, 0}, {kColumns, 0}, {kColumns, kRows}, {0, kRows}};
  cv::Point2f seen[4];
  for (std::size_t i = 0; i < 4; ++i) seen[i] = {float(corners[i].x), float(corners[i].y)};
  const cv::Mat found = cv::getPerspectiveTransform(chart, seen);
  Eigen::Matrix3d matrix;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) matrix(r, c) = found.at<double>(r, c);
  }
  return matrix;
}

ChartPatch read_patch(core::ImageView picture, double saturation, const Eigen::Matrix3d& place, int index) {
  ChartPatch patch;
  patch.name = kReference[std::size_t(index)].name;
  patch.reference = rec709_from_lab(kReference[std::size_t(index)].lab);
  const double column = index % kColumns + 0.5, row = index / kColumns + 0.5;
  const Eigen::Vector3d middle = place * Eigen::Vector3d(column, row, 1);
  patch.centre = {middle[0] / middle[2], middle[1] / middle[2]};
  // The inner half each way, in as many samples as it has pixels, but for the largest pictures.
  const Eigen::Vector3d beside = place * Eigen::Vector3d(column + 0.5, row, 1);
  const double half_px = std::hypot(beside[0] / beside[2] - patch.centre.x, beside[1] / beside[2] - patch.centre.y);
  const int samples = std::clamp(int(half_px), 4, 40);
  std::array<std::vector<double>, 3> values;
  std::size_t clipped = 0, seen = 0;
  for (int j = 0; j < samples; ++j) {
    for (int i = 0; i < samples; ++i) {
      const Eigen::Vector3d at =
          place * Eigen::Vector3d(column - 0.25 + 0.5 * (i + 0.5) / samples, row - 0.25 + 0.5 * (j + 0.5) / samples, 1);
      const int x = int(std::lround(at[0] / at[2])), y = int(std::lround(at[1] / at[2]));
      if (x < 0 || y < 0 || x >= picture.width() || y >= picture.height()) continue;
      const float* pixel = picture.pixel(y, x);
      ++seen;
      clipped +=
          saturation > 0 && std::any_of(pixel, pixel + 3, [&](float v) { return double(v) >= kClipped * saturation; });
      for (std::size_t c = 0; c < 3; ++c) values[c].push_back(double(pixel[c]));
    }
  }
  if (seen < std::size_t(samples * samples)) {
    patch.used = false;
    patch.reason = "outside the picture";
    return patch;
  }
  bool dark = true, uneven = false;
  for (std::size_t c = 0; c < 3; ++c) {
    std::vector<double> scratch = values[c];
    const double middle_value = quantile(scratch, 0.5);
    for (double& v : scratch) v -= middle_value;
    const double sigma = robust_sigma(scratch);
    double sum = 0;
    std::size_t count = 0;
    for (const double v : values[c]) {
      if (std::abs(v - middle_value) > 3 * sigma) continue;
      sum += v - middle_value;
      ++count;
    }
    patch.value[c] = middle_value + (count > 0 ? sum / double(count) : 0);
    patch.sigma[c] = sigma / std::sqrt(double(std::max<std::size_t>(count, 1)));
    dark = dark && !(patch.value[c] > 5 * patch.sigma[c] && patch.value[c] > 0);
    uneven = uneven || sigma > 0.3 * std::abs(patch.value[c]) + 1e-12;
  }
  if (double(clipped) > kClippedShare * double(seen)) {
    patch.reason = "clipped: expose less";
  } else if (dark) {
    patch.reason = "dark";
  } else if (uneven && index != kPatches - 1) {
    patch.reason = "uneven: a shadow, a reflection, or not the chart";
  }
  patch.used = patch.reason.empty();
  return patch;
}

std::vector<ChartPatch> read_patches(core::ImageView picture, double saturation, const Corners& corners) {
  const Eigen::Matrix3d place = picture_from_chart(corners);
  std::vector<ChartPatch> patches;
  for (int i = 0; i < kPatches; ++i) patches.push_back(read_patch(picture, saturation, place, i));
  return patches;
}

// How well luminances follow the chart's, from -1 to 1: tells which way up it is.
double likeness(const std::vector<ChartPatch>& patches) {
  double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const double a = std::cbrt(std::max(0.0, patches[i].value[1])), b = kReference[i].lab[0];
    sa += a;
    sb += b;
    saa += a * a;
    sbb += b * b;
    sab += a * b;
  }
  const double n = kPatches;
  return (sab - sa * sb / n) / std::sqrt(std::max(1e-30, (saa - sa * sa / n) * (sbb - sb * sb / n)));
}

Eigen::Vector3d vector(const Triple& v) {
  return {v[0], v[1], v[2]};
}
Triple triple(const Eigen::Vector3d& v) {
  return {v[0], v[1], v[2]};
}

// The whole matrix, row by row.
using Unknowns = Eigen::Matrix<double, 9, 1>;
using Square = Eigen::Matrix<double, 9, 9>;

Eigen::Matrix3d matrix_of(const Unknowns& u) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(u.data());
}

}  // namespace

ChartReading read_chart(core::ImageView picture, double saturation, const std::optional<Corners>& corners) {
  if (picture.channels() != 3) throw core::BadInput("colour chart: the picture must have 3 channels");
  core::require_finite(picture, "colour chart");
  ChartReading reading;
  reading.corners = corners ? *corners : detect(picture);
  reading.patches = read_patches(picture, saturation, reading.corners);
  if (!corners) {
    const auto& c = reading.corners;
    const Corners upside_down{c[2], c[3], c[0], c[1]};
    std::vector<ChartPatch> other = read_patches(picture, saturation, upside_down);
    if (likeness(other) > likeness(reading.patches)) {
      reading.corners = upside_down;
      reading.patches = std::move(other);
    }
  }
  constexpr double kAlike = 0.8;
  if (likeness(reading.patches) < kAlike) {
    throw core::BadInput(
        "colour chart: what was found does not look like one of 24 patches; say where its corners are");
  }
  return reading;
}

ColourFit fit_colour(const ChartReading& reading) {
  std::vector<const ChartPatch*> used;
  std::size_t grey = 0;
  Eigen::Vector3d grey_product = Eigen::Vector3d::Zero(), grey_square = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < reading.patches.size(); ++i) {
    const ChartPatch& patch = reading.patches[i];
    if (!patch.used) continue;
    used.push_back(&patch);
    if (i < std::size_t(kFirstGrey)) continue;
    ++grey;
    const Eigen::Vector3d v = vector(patch.value);
    grey_product += v.cwiseProduct(vector(patch.reference));
    grey_square += v.cwiseProduct(v);
  }
  if (used.size() < kLeastPatches || grey < kLeastGrey) {
    throw core::BadInput("colour chart: only " + std::to_string(used.size()) + " patches can be used, " +
                         std::to_string(grey) + " of them grey; 12 and 2 are needed" +
                         (used.size() < reading.patches.size() ? " (most of the others: " +
                                                                     [&] {
                                                                       for (const ChartPatch& p : reading.patches) {
                                                                         if (!p.used) return p.reason;
                                                                       }
                                                                       return std::string();
                                                                     }() +
                                                                     ")"
                                                               : ""));
  }
  const auto lab_of = [&](const Eigen::Matrix3d& matrix, const ChartPatch& patch) {
    return vector(lab_from_rec709(triple(matrix * vector(patch.value))));
  };
  const auto difference = [&](const Eigen::Matrix3d& matrix, const ChartPatch& patch) {
    return delta_e_2000(triple(lab_of(matrix, patch)), lab_from_rec709(patch.reference));
  };
  Unknowns unknowns = Unknowns::Zero();
  for (int c = 0; c < 3; ++c) unknowns[4 * c] = grey_product[c] / grey_square[c];
  const double scale = unknowns.cwiseAbs().maxCoeff();
  constexpr int kRounds = 20;
  for (int round = 0; round < kRounds; ++round) {
    Square normal = Square::Zero();
    Unknowns side = Unknowns::Zero();
    for (const ChartPatch* patch : used) {
      const Eigen::Vector3d now = lab_of(matrix_of(unknowns), *patch);
      const Eigen::Vector3d off = vector(lab_from_rec709(patch->reference)) - now;
      Eigen::Matrix<double, 3, 9> slopes;
      for (int k = 0; k < 9; ++k) {
        Unknowns there = unknowns;
        const double step = 1e-6 * scale;
        there[k] += step;
        slopes.col(k) = (lab_of(matrix_of(there), *patch) - now) / step;
      }
      normal += slopes.transpose() * slopes;
      side += slopes.transpose() * off;
    }
    unknowns += normal.ldlt().solve(side);
  }
  // What the camera gives of a perfect white: the matrix makes 1 of it in every channel.
  const Eigen::Matrix3d matrix = matrix_of(unknowns);
  const Eigen::Vector3d white = matrix.inverse() * Eigen::Vector3d::Ones();
  if (!matrix.allFinite() || !white.allFinite() || !(white.minCoeff() > 0)) {
    throw core::BadInput(
        "colour chart: no matrix fits the patches; is it the chart, and are the picture's values linear?");
  }
  ColourFit fit;
  fit.used = used.size();
  fit.exposure = 1 / white[1];
  const Eigen::Matrix3d balanced = matrix * white.asDiagonal();
  for (std::size_t r = 0; r < 3; ++r) {
    fit.white_balance[r] = white[1] / white[Eigen::Index(r)];
    for (std::size_t c = 0; c < 3; ++c) fit.matrix[r][c] = balanced(Eigen::Index(r), Eigen::Index(c));
  }
  const Eigen::Matrix3d balance_alone = white.cwiseInverse().asDiagonal();
  for (const ChartPatch& patch : reading.patches) fit.delta_e_balanced.push_back(difference(balance_alone, patch));
  for (std::size_t i = 0; i < reading.patches.size(); ++i) {
    const ChartPatch& patch = reading.patches[i];
    fit.delta_e.push_back(difference(matrix, patch));
    if (!patch.used) continue;
    fit.mean_delta_e += fit.delta_e.back() / double(fit.used);
    fit.mean_delta_e_balanced += fit.delta_e_balanced[i] / double(fit.used);
    fit.largest_delta_e = std::max(fit.largest_delta_e, fit.delta_e.back());
  }
  return fit;
}

}  // namespace lightstage::calib
