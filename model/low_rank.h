// Truncated singular value decomposition of a matrix that is too large to hold: its rows come one at a time.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

namespace lightstage::model {

struct Rows {
  std::size_t count = 0, length = 0;
  // Puts a row into `values`. Each row is asked for once a pass, from several threads. May throw.
  std::function<void(std::size_t row, std::span<float> values)> read;
};

// Orthonormal vectors, the one with the most energy first.
struct RowBasis {
  std::size_t length = 0;
  std::vector<float> vectors;    // rank() x length
  std::vector<double> energies;  // of each: its singular value, squared
  double total_energy = 0;       // of the matrix: the sum of its squared values
  double left_out_energy = 0;    // what the vectors leave out of it, to within the search's own tolerance (below)
  std::size_t rank() const { return energies.size(); }
};

// The fewest leading right singular vectors of diag(sqrt(weights)) * rows that leave out at most error^2 of its energy, in one pass.
//
// Neither the matrix nor its Gram matrix over all rows is made. For n rows of m values and rank r the Gram matrix costs n^2 m products, which must be
// in double precision (it squares the condition number), needs all rows at a time, and then an eigenproblem of size n; a randomised range finder (Halko,
// Martinsson and Tropp 2011, "Finding structure with randomness") costs 2 n m r a pass but has to guess r and pass several times. Here blocks of rows,
// each spread evenly over all of them, are freed of what the vectors so far explain, and the leading eigenvectors of the block's small Gram matrix join the vectors: a
// blocked Gram-Schmidt process with truncation, 4 n m r, whose rank follows from the data. What a block may leave out is an eighth of the
// error asked for (its square: 1.6 % of the energy to be left out), so the vectors are the optimal ones but for that. Residuals are small numbers computed as such, never a
// difference of large ones, so single precision holds errors down to 1e-5.
//
// No vectors for a matrix of zeros. Memory: 2 r m floats and some blocks of at most 64 rows. The result does not depend on
// core::thread_count(). Throws BadInput for no rows or values and for weights that are negative, not finite or not one a row; UsageError unless
// 0 < error < 1; Interrupted.
RowBasis leading_basis(const Rows& rows, std::span<const double> weights, double error);

// What is done with a row and its best approximation; called once a row, from several threads.
using SeeFitted = std::function<void(std::size_t row, std::span<const float> values, std::span<const float> fitted)>;

// The rows' coefficients, count x rank, by least squares in `rank` vectors of their length that are orthonormal but for rounding (by up to some
// tenths of their length). 4 count length rank operations, one pass. Throws as above.
std::vector<double> fit_rows(const Rows& rows, std::span<const float> vectors, std::size_t rank, const SeeFitted& see);

}  // namespace lightstage::model
