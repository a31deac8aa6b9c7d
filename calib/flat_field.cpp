#include "calib/flat_field.h"

#include <Eigen/Dense>
#include <string>

#include "calib/robust/quantile.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"

namespace lightstage::calib {

namespace {

constexpr int kCells = 48;         // along the longer side
constexpr int kLeastSide = 32;     // pixels
constexpr double kClipped = 0.97;  // of saturation: sensors leave linearity a little before they clip
constexpr double kDarkSigmas = 10;
constexpr double kTukey = 4.685;  // 95 % efficient for normal errors
constexpr int kRounds = 8;
constexpr std::size_t kRowGrain = 16;

// Shifted Legendre polynomials of degree 1 to n at u in [0, 1].
void legendre(double u, int n, double* values) {
  double before = 1, now = 2 * u - 1;
  for (int k = 1; k <= n; ++k) {
    values[k - 1] = now;
    const double next = ((2 * k + 1) * (2 * u - 1) * now - k * before) / (k + 1);
    before = now;
    now = next;
  }
}

// Where a pixel lies, in units of the picture's half sides, and the square of its distance from the middle in units of the outer corner's.
struct Lens {
  double height, width;
  double x(double px) const { return (2 * px + 1 - width) / width; }
  double y(double py) const { return (2 * py + 1 - height) / height; }
  double squared_radius(double px, double py) const {
    const double dx = 2 * px + 1 - width, dy = 2 * py + 1 - height;
    return (dx * dx + dy * dy) / (width * width + height * height);
  }
};

struct Cell {
  int column = 0, row = 0;
  double x = 0, y = 0;  // Lens
  double u = 0;         // squared radius, mean over the cell
  double value = 0;     // logarithm of the mean, less that of the illumination
  double variance = 1;  // of it, from the scatter in the cell
  double weight = 0;    // 0: left out
};

// The mean of the values without those far off (dust smaller than the cell), and the variance of that mean.
struct CellMean {
  double mean = 0, variance = 0;
};
CellMean trimmed_mean(std::vector<double>& values, std::vector<double>& scratch) {
  scratch = values;
  const double middle = quantile(scratch, 0.5);
  scratch.clear();
  for (const double v : values) scratch.push_back(v - middle);
  const double limit = 4 * robust_sigma(scratch);
  double sum = 0, squares = 0;
  int count = 0;
  for (const double v : values) {
    if (std::abs(v - middle) > limit) continue;
    sum += v - middle;
    squares += (v - middle) * (v - middle);
    ++count;
  }
  const double mean = sum / count;
  return {middle + mean, count > 1 ? (squares / count - mean * mean) / (count - 1) : 0};
}

// One channel of one picture.
struct View {
  std::vector<Cell> cells;  // all of the grid, row by row
  std::size_t usable = 0;
};

View read_cells(const FlatPicture& picture, int channel, int side) {
  const core::ImageView image = picture.picture;
  const Lens lens{double(image.height()), double(image.width())};
  View view;
  std::vector<double> values, scratch;
  for (int top = 0, row = 0; top < image.height(); top += side, ++row) {
    const int bottom = std::min(top + side, image.height());
    for (int left = 0, column = 0; left < image.width(); left += side, ++column) {
      const int right = std::min(left + side, image.width());
      Cell cell{column, row};
      values.clear();
      bool clipped = false;
      for (int y = top; y < bottom; ++y) {
        for (int x = left; x < right; ++x) {
          const double v = double(image(y, x, channel));
          clipped = clipped || (picture.saturation > 0 && v >= kClipped * picture.saturation);
          // Within a cell the illumination's own slope is of no account.
          values.push_back(v);
          cell.u += lens.squared_radius(x, y);
        }
      }
      const double middle_x = 0.5 * (left + right - 1), middle_y = 0.5 * (top + bottom - 1);
      cell.x = lens.x(middle_x);
      cell.y = lens.y(middle_y);
      cell.u /= double(values.size());
      const CellMean mean = trimmed_mean(values, scratch);
      const double light = picture.illumination ? picture.illumination(middle_x, middle_y) : 1.0;
      if (!clipped && light > 0 && mean.mean > 0 && mean.mean * mean.mean > kDarkSigmas * kDarkSigmas * mean.variance) {
        cell.value = std::log(mean.mean / light);
        // A picture without noise has scatter 0: cells then count alike.
        cell.variance = std::max(mean.variance / (mean.mean * mean.mean), 1e-10);
        cell.weight = 1;
        ++view.usable;
      }
      view.cells.push_back(cell);
    }
  }
  return view;
}

// The fit of one channel.
struct ChannelFit {
  Eigen::VectorXd radial;              // a_k
  Eigen::MatrixXd covariance;          // of them
  std::vector<Eigen::Vector3d> plane;  // c, gx, gy per view
  double condition = 0;
  double sigma = 0;  // robust, relative, of a cell
  std::size_t rejected = 0;
};

class Fit {
 public:
  Fit(std::vector<View>& views, int degree) : views_(views), degree_(degree) {}

  ChannelFit run() {
    ChannelFit fit;
    for (int round = 0; round < kRounds; ++round) {
      solve(fit);
      reweigh(fit);
    }
    solve(fit);
    judge(fit);
    return fit;
  }

 private:
  Eigen::VectorXd radial_row(const Cell& cell) const {
    Eigen::VectorXd row(degree_);
    legendre(cell.u, degree_, row.data());
    return row;
  }
  static Eigen::Vector3d plane_row(const Cell& cell) { return {1, cell.x, cell.y}; }

  // Weighted normal equations of one view: radial with radial, radial with plane, plane with plane, and right-hand sides.
  struct Normal {
    Eigen::MatrixXd rr, rp;
    Eigen::Matrix3d pp = Eigen::Matrix3d::Zero();
    Eigen::VectorXd r;
    Eigen::Vector3d p = Eigen::Vector3d::Zero();
    // Without the plane.
    Eigen::MatrixXd reduced() const { return rr - rp * pp.ldlt().solve(rp.transpose()); }
    Eigen::VectorXd reduced_side() const { return r - rp * pp.ldlt().solve(p); }
  };
  Normal normal(const View& view) const {
    Normal n;
    n.rr = Eigen::MatrixXd::Zero(degree_, degree_);
    n.rp = Eigen::MatrixXd::Zero(degree_, 3);
    n.r = Eigen::VectorXd::Zero(degree_);
    for (const Cell& cell : view.cells) {
      if (!(cell.weight > 0)) continue;
      const double w = cell.weight / cell.variance;
      const Eigen::VectorXd a = radial_row(cell);
      const Eigen::Vector3d b = plane_row(cell);
      n.rr += w * a * a.transpose();
      n.rp += w * a * b.transpose();
      n.pp += w * b * b.transpose();
      n.r += w * cell.value * a;
      n.p += w * cell.value * b;
    }
    return n;
  }

  void solve(ChannelFit& fit) {
    normals_.clear();
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(degree_, degree_);
    Eigen::VectorXd side = Eigen::VectorXd::Zero(degree_);
    for (const View& view : views_) {
      normals_.push_back(normal(view));
      matrix += normals_.back().reduced();
      side += normals_.back().reduced_side();
    }
    const Eigen::VectorXd scale = matrix.diagonal().cwiseSqrt();
    const Eigen::MatrixXd scaled = scale.cwiseInverse().asDiagonal() * matrix * scale.cwiseInverse().asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
    // The normal matrix has the square of the design's.
    fit.condition = std::sqrt(eigen.eigenvalues().maxCoeff() / std::max(eigen.eigenvalues().minCoeff(), 1e-300));
    fit.radial = matrix.ldlt().solve(side);
    fit.covariance = matrix.inverse();
    fit.plane.clear();
    for (const Normal& n : normals_) fit.plane.push_back(n.pp.ldlt().solve(n.p - n.rp.transpose() * fit.radial));
  }

  double residual(const ChannelFit& fit, std::size_t view, const Cell& cell) const {
    return cell.value - radial_row(cell).dot(fit.radial) - plane_row(cell).dot(fit.plane[view]);
  }

  void reweigh(ChannelFit& fit) {
    std::vector<double> scaled, relative;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      for (const Cell& cell : views_[v].cells) {
        if (!usable(cell)) continue;
        relative.push_back(residual(fit, v, cell));
        scaled.push_back(relative.back() / std::sqrt(cell.variance));
      }
    }
    fit.sigma = robust_sigma(relative);
    scale_ = std::max(robust_sigma(scaled), 1e-12);
    fit.rejected = 0;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      for (Cell& cell : views_[v].cells) {
        if (!usable(cell)) continue;
        const double t = residual(fit, v, cell) / std::sqrt(cell.variance) / (kTukey * scale_);
        cell.weight = t * t < 1 ? std::max((1 - t * t) * (1 - t * t), 1e-12) : 1e-12;
        fit.rejected += t * t >= 1;
      }
    }
  }
  static bool usable(const Cell& cell) { return cell.weight > 0; }

  // Scales the covariance by the scatter of cells about the fit, and by that of the views about each other where it is larger.
  void judge(ChannelFit& fit) const {
    double factor = scale_ * scale_ / 0.95;
    if (views_.size() > 1) {
      double squares = 0;
      for (const Normal& n : normals_) {
        const Eigen::MatrixXd own = n.reduced();
        const Eigen::VectorXd off = own.ldlt().solve(n.reduced_side()) - fit.radial;
        squares += off.dot(own * off);
      }
      factor = std::max(factor, squares / double((views_.size() - 1) * std::size_t(degree_)));
    }
    fit.covariance *= factor;
  }

  std::vector<View>& views_;
  int degree_;
  std::vector<Normal> normals_;
  double scale_ = 1;  // of the cells' residuals over their own standard errors
};

// What the views' cells have in common beyond the fit: the median over views, smoothed by a binomial window of five cells twice.
class Residual {
 public:
  Residual(const std::vector<View>& views, const ChannelFit& fit, int degree, int side) : side_(side) {
    const std::vector<Cell>& cells = views.front().cells;
    columns_ = cells.back().column + 1;
    rows_ = cells.back().row + 1;
    values_.assign(cells.size(), 0);
    std::vector<double> row(static_cast<std::size_t>(degree)), off;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      off.clear();
      for (std::size_t v = 0; v < views.size(); ++v) {
        const Cell& cell = views[v].cells[i];
        if (!(cell.weight > 1e-6)) continue;
        legendre(cell.u, degree, row.data());
        double predicted = fit.plane[v].dot(Eigen::Vector3d(1, cell.x, cell.y));
        for (int k = 0; k < degree; ++k) predicted += fit.radial[k] * row[std::size_t(k)];
        off.push_back(cell.value - predicted);
      }
      values_[i] = quantile(off, 0.5);
    }
    for (int i = 0; i < 2; ++i) {
      blur(1, columns_);
      blur(columns_, rows_);
    }
    const double middle =
        at(0.5 * (columns_ - 1) * side_ + 0.5 * (side_ - 1), 0.5 * (rows_ - 1) * side_ + 0.5 * (side_ - 1));
    for (double& v : values_) v -= middle;
  }

  double at(double x, double y) const {
    const double u = std::clamp((x - 0.5 * (side_ - 1)) / side_, 0.0, double(columns_ - 1));
    const double v = std::clamp((y - 0.5 * (side_ - 1)) / side_, 0.0, double(rows_ - 1));
    const int c = std::min(int(u), columns_ - 2), r = std::min(int(v), rows_ - 2);
    const double fx = u - c, fy = v - r;
    return (1 - fy) * ((1 - fx) * value(r, c) + fx * value(r, c + 1)) +
           fy * ((1 - fx) * value(r + 1, c) + fx * value(r + 1, c + 1));
  }

 private:
  double value(int r, int c) const { return values_[std::size_t(r * columns_ + c)]; }
  // Along lines of `length` cells, `step` apart in the list; repeats the ends.
  void blur(int step, int length) {
    const std::vector<double> before = values_;
    for (int i = 0; i < rows_ * columns_; ++i) {
      const int place = step == 1 ? i % columns_ : i / columns_;
      constexpr double kBinomial[] = {1. / 16, 4. / 16, 6. / 16, 4. / 16, 1. / 16};
      double sum = 0;
      for (int k = -2; k <= 2; ++k) {
        sum += kBinomial[k + 2] * before[std::size_t(i + (std::clamp(place + k, 0, length - 1) - place) * step)];
      }
      values_[std::size_t(i)] = sum;
    }
  }

  int side_, columns_ = 0, rows_ = 0;
  std::vector<double> values_;
};

void check(std::span<const FlatPicture> pictures, const FlatOptions& options) {
  if (pictures.empty()) throw core::BadInput("flat field: there are no pictures");
  if (options.degree < 1 || options.degree > 5) throw core::BadInput("flat field: the degree must be 1 to 5");
  const core::ImageSize size = pictures.front().picture.size();
  if (size.height < kLeastSide || size.width < kLeastSide) {
    throw core::BadInput("flat field: pictures must be " + std::to_string(kLeastSide) +
                         " pixels high and wide at least");
  }
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    if (pictures[i].picture.size() != size) {
      throw core::BadInput("flat field: picture " + std::to_string(i) + " is of another size than picture 0");
    }
    core::require_finite(pictures[i].picture, "flat field, picture " + std::to_string(i));
  }
}

}  // namespace

FlatField fit_flat_field(std::span<const FlatPicture> pictures, const FlatOptions& options) {
  check(pictures, options);
  const core::ImageSize size = pictures.front().picture.size();
  const int longer = std::max(size.height, size.width), shorter = std::min(size.height, size.width);
  const int side = std::max(4, std::min((longer + kCells - 1) / kCells, shorter / 4));
  const Lens lens{double(size.height), double(size.width)};
  const int degree = options.degree;

  FlatField field;
  field.flat = core::Image(size);
  field.gradients.assign(pictures.size(), {0, 0});
  constexpr int kProfile = 65;
  for (int i = 0; i < kProfile; ++i) field.profile.push_back({double(i) / (kProfile - 1), 0});
  std::size_t cells = 0, left_out = 0;
  for (int channel = 0; channel < size.channels; ++channel) {
    std::vector<View> views(pictures.size());
    core::parallel_for(pictures.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) views[i] = read_cells(pictures[i], channel, side);
    });
    for (std::size_t i = 0; i < views.size(); ++i) {
      cells += views[i].cells.size();
      left_out += views[i].cells.size() - views[i].usable;
      if (2 * views[i].usable < views[i].cells.size()) {
        throw core::BadInput(
            "flat field: more than half of picture " + std::to_string(i) +
            " is clipped or too dark; the white card must fill the picture, exposed to about half of the "
            "sensor's range");
      }
    }
    const ChannelFit fit = Fit(views, degree).run();
    left_out += fit.rejected;
    field.condition = std::max(field.condition, fit.condition);
    field.residual = std::max(field.residual, fit.sigma);
    std::vector<double> at_middle(std::size_t(degree), 0);
    legendre(0, degree, at_middle.data());
    const auto log_radial = [&](double u) {
      double row[5];
      legendre(u, degree, row);
      double sum = 0;
      for (int k = 0; k < degree; ++k) sum += fit.radial[k] * (row[k] - at_middle[std::size_t(k)]);
      return sum;
    };
    for (std::array<double, 2>& point : field.profile) {
      const double u = point[0] * point[0];
      point[1] += std::exp(log_radial(u)) / size.channels;
      Eigen::VectorXd row(degree);
      legendre(u, degree, row.data());
      for (int k = 0; k < degree; ++k) row[k] -= at_middle[std::size_t(k)];
      field.sigma = std::max(field.sigma, std::sqrt(std::max(0.0, row.dot(fit.covariance * row))));
    }
    field.corner.push_back(std::exp(log_radial(1)));
    for (std::size_t i = 0; i < views.size(); ++i) {
      for (std::size_t axis = 0; axis < 2; ++axis) {
        field.gradients[i][axis] += std::expm1(fit.plane[i][Eigen::Index(axis + 1)]) / size.channels;
      }
    }
    std::optional<Residual> residual;
    if (options.smooth_residual) residual.emplace(views, fit, degree, side);
    core::parallel_for(std::size_t(size.height), kRowGrain, [&](std::size_t first, std::size_t last) {
      for (int y = int(first); y < int(last); ++y) {
        for (int x = 0; x < size.width; ++x) {
          const double beyond = residual ? residual->at(x, y) : 0;
          field.flat(y, x, channel) = float(std::exp(log_radial(lens.squared_radius(x, y)) + beyond));
        }
      }
    });
  }
  field.rejected = double(left_out) / double(cells);
  return field;
}

}  // namespace lightstage::calib
