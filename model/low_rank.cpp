#include "model/low_rank.h"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/parallel.h"

namespace lightstage::model {

namespace {

using torch::Tensor;

constexpr std::size_t kBlockRows = 64;
constexpr std::size_t kBlockValues = std::size_t(1) << 26;  // a quarter of a gigabyte
constexpr double kShareOfError = 1.0 / 8;                   // that the search for the vectors may make
constexpr double kRoundingEnergy = 1e-12;                   // of single-precision rows: below it nothing is known

// Blocks of rows, each spread evenly over all: the first already knows something of every part, so that later ones add little.
class Blocks {
 public:
  explicit Blocks(const Rows& rows) : rows_(rows) {
    const std::size_t most = std::clamp(kBlockValues / rows.length, std::size_t(1), kBlockRows);
    count_ = (rows.count - 1) / most + 1;
  }
  std::size_t count() const { return count_; }
  std::vector<std::size_t> members(std::size_t block) const {
    std::vector<std::size_t> members;
    for (std::size_t row = block; row < rows_.count; row += count_) members.push_back(row);
    return members;
  }
  Tensor read(const std::vector<std::size_t>& members) const {
    core::throw_if_interrupted();
    Tensor block = torch::empty({std::int64_t(members.size()), std::int64_t(rows_.length)});
    float* const values = block.data_ptr<float>();
    core::parallel_for(members.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) rows_.read(members[i], {values + i * rows_.length, rows_.length});
    });
    return block;
  }

 private:
  const Rows& rows_;
  std::size_t count_ = 0;
};

void require_rows(const Rows& rows) {
  if (rows.count == 0 || rows.length == 0) throw core::BadInput("a matrix without values has no singular vectors");
}

double energy_of(const Tensor& rows) {
  return rows.square().sum(1).to(torch::kFloat64).sum().item<double>();
}

// Eigenvalues and vectors (columns) of a small symmetric matrix, the largest first.
std::pair<Tensor, Tensor> eigen(const Tensor& symmetric) {
  const auto [values, vectors] = at::linalg_eigh(symmetric.to(torch::kFloat64));
  return {values.flip(0).clamp_min(0), vectors.flip(1)};
}

// How many of the leading energies leave out at most so much.
std::int64_t fewest(const Tensor& energies, double most_left_out) {
  std::int64_t kept = energies.size(0);
  double left_out = 0;
  while (kept > 0) {
    left_out += energies[kept - 1].item<double>();
    if (left_out > most_left_out) break;
    --kept;
  }
  return kept;
}

// Vectors found so far, in the pieces in which they were found.
class GrowingBasis {
 public:
  std::int64_t size() const { return size_; }

  // Takes out of the rows what the vectors explain; returns the coefficients of that.
  Tensor take_from(Tensor& rows) const {
    std::vector<Tensor> coefficients{torch::empty({rows.size(0), 0})};
    for (const Tensor& piece : pieces_) coefficients.push_back(rows.mm(piece.t()));
    for (std::size_t i = 0; i < pieces_.size(); ++i) rows.addmm_(coefficients[i + 1], pieces_[i], 1, -1);
    return torch::cat(coefficients, 1);
  }

  // Adds the directions in which these rows, already without what the vectors explain, have their energy, all but so much of it.
  void add_from(const Tensor& rows, double most_left_out) {
    const Tensor exact = rows.to(torch::kFloat64);  // their Gram matrix squares the ratio of strong to weak directions
    const auto [energies, directions] = eigen(exact.mm(exact.t()));
    const std::int64_t kept = fewest(energies, most_left_out);
    if (kept == 0) return;
    const Tensor mix = directions.narrow(1, 0, kept) / energies.narrow(0, 0, kept).sqrt();
    Tensor vectors = mix.t().mm(exact).to(torch::kFloat32);
    // Weak directions have lost some of their right angles to rounding; they get them back here.
    take_from(vectors);
    const auto [lengths, turn] = eigen(vectors.mm(vectors.t()));
    pieces_.push_back((turn / lengths.sqrt()).t().to(torch::kFloat32).mm(vectors));
    size_ += kept;
  }

  // Combinations of the vectors (a row of `mix` each) as one matrix; the vectors themselves are given up on the way.
  Tensor combined(const Tensor& mix, std::int64_t length) && {
    Tensor result = torch::zeros({mix.size(0), length});
    std::int64_t at = 0;
    for (Tensor& piece : pieces_) {
      result.addmm_(mix.narrow(1, at, piece.size(0)), piece);
      at += piece.size(0);
      piece = Tensor();
    }
    return result;
  }

 private:
  std::vector<Tensor> pieces_;
  std::int64_t size_ = 0;
};

}  // namespace

RowBasis leading_basis(const Rows& rows, std::span<const double> weights, double error) {
  require_rows(rows);
  if (weights.size() != rows.count ||
      std::any_of(weights.begin(), weights.end(), [](double w) { return !std::isfinite(w) || w < 0; }))
    throw core::BadInput("a weighted matrix needs one finite weight a row that is not negative");
  if (!(error > 0 && error < 1))
    throw core::UsageError("an error must lie between 0 and 1, not at " + std::to_string(error));

  const torch::NoGradGuard no_gradients;
  const double tolerance = kShareOfError * error;
  GrowingBasis found;
  std::vector<Tensor> coefficients;
  RowBasis basis{.length = rows.length};
  double missed = 0;
  const Blocks blocks(rows);
  for (std::size_t b = 0; b < blocks.count(); ++b) {
    const std::vector<std::size_t> members = blocks.members(b);
    Tensor block = blocks.read(members);
    for (std::size_t i = 0; i < members.size(); ++i) block[std::int64_t(i)] *= std::sqrt(weights[members[i]]);
    const double energy = energy_of(block);
    basis.total_energy += energy;
    const Tensor explained = found.take_from(block);
    const std::int64_t before = found.size();
    found.add_from(block, std::max(tolerance * tolerance, kRoundingEnergy) * energy);
    // What the new vectors explain; the older ones get the little that rounding had left.
    const Tensor rest = found.take_from(block);
    const Tensor padding = torch::zeros({explained.size(0), found.size() - before});
    coefficients.push_back((torch::cat({explained, padding}, 1) + rest).to(torch::kFloat64));
    missed += energy_of(block);
  }

  const std::int64_t size = found.size();
  if (size == 0) return basis;
  Tensor gram = torch::zeros({size, size}, torch::kFloat64);
  for (const Tensor& c : coefficients) gram.narrow(0, 0, c.size(1)).narrow(1, 0, c.size(1)).add_(c.t().mm(c));
  const auto [energies, directions] = eigen(gram);
  const std::int64_t rank = fewest(energies, error * error * basis.total_energy - missed);
  const double kept = energies.narrow(0, 0, rank).sum().item<double>();
  basis.left_out_energy = energies.sum().item<double>() - kept + missed;
  const Tensor kept_energies = energies.narrow(0, 0, rank).contiguous();
  basis.energies.assign(kept_energies.data_ptr<double>(), kept_energies.data_ptr<double>() + rank);
  const Tensor vectors = std::move(found).combined(directions.narrow(1, 0, rank).t().to(torch::kFloat32).contiguous(),
                                                   std::int64_t(rows.length));
  basis.vectors.assign(vectors.data_ptr<float>(), vectors.data_ptr<float>() + vectors.numel());
  return basis;
}

std::vector<double> fit_rows(const Rows& rows, std::span<const float> vectors, std::size_t rank, const SeeFitted& see) {
  require_rows(rows);
  if (vectors.size() != rank * rows.length) throw core::BadInput("vectors are not of the length of the rows");
  const torch::NoGradGuard no_gradients;
  const std::int64_t length = std::int64_t(rows.length);
  const Tensor basis = torch::from_blob(const_cast<float*>(vectors.data()), {std::int64_t(rank), length});
  const Tensor factor = at::linalg_cholesky(basis.mm(basis.t()).to(torch::kFloat64));
  std::vector<double> coefficients(rows.count * rank);
  const Blocks blocks(rows);
  for (std::size_t b = 0; b < blocks.count(); ++b) {
    const std::vector<std::size_t> members = blocks.members(b);
    const Tensor block = blocks.read(members);
    const Tensor products = basis.mm(block.t()).to(torch::kFloat64);
    const Tensor solved = at::cholesky_solve(products, factor).t().contiguous();
    const Tensor fitted = solved.to(torch::kFloat32).mm(basis);
    core::parallel_for(members.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        std::copy_n(solved.data_ptr<double>() + i * rank, rank, coefficients.data() + members[i] * rank);
        see(members[i], {block.data_ptr<float>() + i * rows.length, rows.length},
            {fitted.data_ptr<float>() + i * rows.length, rows.length});
      }
    });
  }
  return coefficients;
}

}  // namespace lightstage::model
