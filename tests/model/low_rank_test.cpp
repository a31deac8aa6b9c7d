// Truncated singular value decomposition, against OpenCV's dense one of the whole matrix.
#include <catch2/catch.hpp>
#include <numeric>
#include <opencv2/core.hpp>
#include <random>

#include "core/error.h"
#include "core/parallel.h"
#include "model/low_rank.h"

namespace lightstage {

namespace {

using model::RowBasis;
using model::Rows;

// Of singular values about decay^k, so that any error has a rank of its own.
cv::Mat decaying(int count, int length, double decay, std::uint64_t seed) {
  cv::RNG random(seed);
  cv::Mat left(count, count, CV_64F), right(count, length, CV_64F);
  random.fill(left, cv::RNG::NORMAL, 0, 1);
  random.fill(right, cv::RNG::NORMAL, 0, 1);
  for (int k = 0; k < count; ++k) right.row(k) *= std::pow(decay, k);
  cv::Mat single;
  cv::Mat(left * right).convertTo(single, CV_32F);
  return single;
}

Rows rows_of(const cv::Mat& matrix) {
  return {std::size_t(matrix.rows), std::size_t(matrix.cols), [&matrix](std::size_t row, std::span<float> values) {
            std::copy_n(matrix.ptr<float>(int(row)), values.size(), values.begin());
          }};
}

// The energies (squared singular values) of the weighted matrix, by the book.
std::vector<double> reference_energies(const cv::Mat& matrix, std::span<const double> weights) {
  cv::Mat weighted;
  matrix.convertTo(weighted, CV_64F);
  for (int i = 0; i < matrix.rows; ++i) weighted.row(i) *= std::sqrt(weights[std::size_t(i)]);
  const cv::SVD dense(weighted, cv::SVD::NO_UV);
  std::vector<double> energies(dense.w.begin<double>(), dense.w.end<double>());
  for (double& e : energies) e *= e;
  return energies;
}

std::size_t smallest_rank(const std::vector<double>& energies, double error) {
  const double total = std::accumulate(energies.begin(), energies.end(), 0.0);
  std::size_t rank = energies.size();
  for (double left_out = 0; rank > 0; --rank) {
    left_out += energies[rank - 1];
    if (left_out > error * error * total) break;
  }
  return rank;
}

struct Fit {
  std::vector<double> coefficients, squared_errors;
};

Fit fit(const Rows& rows, const RowBasis& basis) {
  Fit result;
  result.squared_errors.resize(rows.count);
  result.coefficients = model::fit_rows(rows, basis.vectors, basis.rank(),
                                        [&](std::size_t row, std::span<const float> is, std::span<const float> fitted) {
                                          double squared = 0;
                                          for (std::size_t i = 0; i < is.size(); ++i)
                                            squared += std::pow(double(is[i]) - double(fitted[i]), 2);
                                          result.squared_errors[row] = squared;
                                        });
  return result;
}

std::vector<double> uneven_weights(std::size_t count) {
  std::vector<double> weights;
  for (std::size_t i = 0; i < count; ++i) weights.push_back(0.2 + double(i * 7 % 5));
  return weights;
}

}  // namespace

TEST_CASE("the leading vectors leave out what was asked, in the rank of the dense decomposition") {
  for (const double error : {0.3, 0.03, 0.001}) {
    for (const auto& [count, length] : {std::pair(90, 150), std::pair(200, 67), std::pair(70, 1)}) {
      CAPTURE(error, count, length);
      const cv::Mat matrix = decaying(count, length, 0.9, 5);
      const std::vector<double> weights = uneven_weights(std::size_t(count));
      const std::vector<double> reference = reference_energies(matrix, weights);
      const RowBasis basis = model::leading_basis(rows_of(matrix), weights, error);
      const std::size_t best = smallest_rank(reference, error);
      CHECK(basis.rank() >= best);
      CHECK(basis.rank() <= best + 1 + best / 50);
      CHECK(basis.total_energy == Approx(std::accumulate(reference.begin(), reference.end(), 0.0)).epsilon(1e-5));
      CHECK(basis.left_out_energy <= error * error * basis.total_energy * 1.0001);
      CHECK(basis.energies.front() == Approx(reference.front()).epsilon(1e-3));

      const Fit fitted = fit(rows_of(matrix), basis);
      double left_out = 0;
      for (std::size_t i = 0; i < weights.size(); ++i) left_out += weights[i] * fitted.squared_errors[i];
      // Fitted anew, rows gain what the search left out.
      CHECK(std::sqrt(left_out / basis.total_energy) <= error * 1.0001);
      CHECK(std::sqrt(left_out / basis.total_energy) <= 1.001 * std::sqrt(basis.left_out_energy / basis.total_energy));
    }
  }
}

TEST_CASE("the leading vectors are at right angles and of unit length") {
  const cv::Mat matrix = decaying(150, 300, 0.8, 11);  // singular values over fourteen orders of magnitude
  const RowBasis basis = model::leading_basis(rows_of(matrix), std::vector<double>(150, 1.0), 1e-4);
  for (std::size_t a = 0; a < basis.rank(); ++a) {
    for (std::size_t b = 0; b <= a; ++b) {
      double product = 0;
      for (std::size_t i = 0; i < basis.length; ++i)
        product += double(basis.vectors[a * basis.length + i]) * double(basis.vectors[b * basis.length + i]);
      REQUIRE(product == Approx(a == b ? 1.0 : 0.0).margin(2e-5));
    }
  }
  CHECK(std::is_sorted(basis.energies.rbegin(), basis.energies.rend()));
}

TEST_CASE("a matrix of full rank is given back whole, one of equal rows by one vector, one of zeros by none") {
  const cv::Mat full = decaying(40, 90, 1, 3);
  const RowBasis whole = model::leading_basis(rows_of(full), std::vector<double>(40, 1.0), 1e-5);
  CHECK(whole.rank() == 40);
  for (const double squared : fit(rows_of(full), whole).squared_errors) CHECK(squared < 1e-9 * whole.total_energy / 40);

  const cv::Mat equal = cv::repeat(full.row(0), 130, 1);
  const RowBasis one = model::leading_basis(rows_of(equal), std::vector<double>(130, 2.0), 1e-5);
  CHECK(one.rank() == 1);
  const Fit same = fit(rows_of(equal), one);
  for (const double c : same.coefficients) CHECK(c == same.coefficients.front());

  const cv::Mat zeros = cv::Mat::zeros(5, 7, CV_32F);
  const RowBasis none = model::leading_basis(rows_of(zeros), std::vector<double>(5, 1.0), 0.01);
  CHECK(none.rank() == 0);
  CHECK(none.total_energy == 0);
  for (const double squared : fit(rows_of(zeros), none).squared_errors) CHECK(squared == 0);
}

TEST_CASE("a weak direction beside a value a million times stronger is found when the error asks for it") {
  cv::Mat matrix = decaying(80, 120, 0.95, 8);
  matrix *= 1e-3 / cv::norm(matrix, cv::NORM_INF);
  matrix.at<float>(17, 60) = 1e3f;
  const RowBasis coarse = model::leading_basis(rows_of(matrix), std::vector<double>(80, 1.0), 0.01);
  CHECK(coarse.rank() == 1);
  const RowBasis fine = model::leading_basis(rows_of(matrix), std::vector<double>(80, 1.0), 2e-6);
  CHECK(fine.rank() > 1);
  for (const float v : fine.vectors) REQUIRE(std::isfinite(v));
}

TEST_CASE("the decomposition is the same on every number of threads") {
  const cv::Mat matrix = decaying(130, 501, 0.93, 21);
  const std::vector<double> weights = uneven_weights(130);
  const auto on = [&](int threads) {
    core::set_thread_count(threads);
    const RowBasis basis = model::leading_basis(rows_of(matrix), weights, 0.01);
    const Fit fitted = fit(rows_of(matrix), basis);
    core::set_thread_count(0);
    return std::pair(basis.vectors, fitted.coefficients);
  };
  const auto one = on(1);
  CHECK(on(3) == one);
  CHECK(on(2) == one);
}

TEST_CASE("a decomposition that cannot be asked for is refused") {
  const cv::Mat matrix = decaying(4, 6, 1, 2);
  const std::vector<double> weights(4, 1.0);
  const Rows rows = rows_of(matrix);
  CHECK_THROWS_AS(model::leading_basis({0, 6, rows.read}, {}, 0.1), core::BadInput);
  CHECK_THROWS_AS(model::leading_basis({4, 0, rows.read}, weights, 0.1), core::BadInput);
  CHECK_THROWS_AS(model::leading_basis(rows, std::vector<double>(3, 1.0), 0.1), core::BadInput);
  CHECK_THROWS_AS(model::leading_basis(rows, std::vector<double>{1, 1, -1, 1}, 0.1), core::BadInput);
  for (const double error : {0.0, 1.0, -1.0, double(NAN)})
    CHECK_THROWS_AS(model::leading_basis(rows, weights, error), core::UsageError);
  const std::vector<float> vectors(12);
  CHECK_THROWS_AS(model::fit_rows(rows, vectors, 3, [](auto&&...) {}), core::BadInput);
}

}  // namespace lightstage
