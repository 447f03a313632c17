// Kolotilina, Yeremin 1993, "Factorized sparse approximate inverse preconditionings I" (the
// method). Kaporin 1994, "New convergence results and preconditioning strategies for the conjugate
// gradient method" (what it minimises). Schaefer, Katzfuss, Owhadi 2021, "Sparse Cholesky
// factorization by Kullback-Leibler minimization" (the same factor, for Gram matrices of kernels).

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/solve/batch_cholesky.h>
#include <surfel/solve/inverse_factor.h>
#include <surfel/solve/range_sums.h>

namespace surfel {
namespace {

constexpr std::size_t kMaxRowEntries = 255;  ///< A slot is a byte, and 0 means none.

/// The first entry of a row whose column is at least `column`, or its end.
std::uint64_t first_from(const SymmetricMatrix& matrix, std::size_t row, std::size_t column) {
  const std::uint32_t* columns = matrix.column.data();
  return static_cast<std::uint64_t>(std::lower_bound(columns + matrix.row_begin[row],
                                                     columns + matrix.row_begin[row + 1], column) -
                                    columns);
}

/// 1 / sqrt(a_ii); 1 where the diagonal is not positive.
Array<double> inverse_roots(const SymmetricMatrix& matrix) {
  Array<double> root(matrix.rows());
  parallel_for(root.size(), kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      const double diagonal = matrix.diagonal(i);
      root[i] = diagonal > 0 ? 1 / std::sqrt(diagonal) : 1;
    }
  });
  return root;
}

SparseMatrixF transposed(const SparseMatrixF& matrix) {
  const std::size_t n = matrix.rows();
  SparseMatrixF result;
  result.row_begin.assign(n + 1, 0);
  result.column.resize(matrix.column.size());
  result.value.resize(matrix.value.size());
  for (const std::uint32_t column : matrix.column) ++result.row_begin[column + 1];
  for (std::size_t i = 0; i < n; ++i) result.row_begin[i + 1] += result.row_begin[i];
  Array<std::uint64_t> next(result.row_begin.begin(), result.row_begin.end() - 1);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::uint64_t entry = matrix.row_begin[i]; entry < matrix.row_begin[i + 1]; ++entry) {
      const std::uint64_t to = next[matrix.column[entry]]++;
      result.column[to] = static_cast<std::uint32_t>(i);
      result.value[to] = matrix.value[entry];
    }
  }
  return result;
}

/// Fills in the rows of a factor whose row_begin is set; one for each thread.
class RowBuilder {
 public:
  RowBuilder(const SymmetricMatrix& matrix, const Array<double>& root, std::size_t row_entries,
             SparseMatrixF& factor)
      : matrix_(matrix), root_(root), factor_(factor) {
    slot_.assign(matrix.rows(), 0);
    slot_value_.assign(row_entries + 1, 0);
    slot_root_.resize(row_entries);
    matrices_.resize(batch_entry(row_entries, 0));
    rows_.resize(row_entries * kCholeskyBatch);
  }

  /// Rows [begin, begin + count), at most kCholeskyBatch.
  void build(std::size_t begin, std::size_t count) {
    std::size_t size = 0;
    for (std::size_t row = begin; row < begin + count; ++row) {
      size = std::max(size, entries(row));
    }
    for (std::size_t lane = 0; lane < kCholeskyBatch; ++lane) {
      const std::size_t own = lane < count ? entries(begin + lane) : 0;
      set_identity(size - own, lane);
      if (own == 0) continue;
      find_pattern(begin + lane);
      gather(begin + lane, size - own, lane);
    }
    last_inverse_rows(size, matrices_.data(), rows_.data());
    for (std::size_t lane = 0; lane < count; ++lane) {
      const std::uint64_t first = factor_.row_begin[begin + lane];
      const std::size_t own = entries(begin + lane);
      const double* row = rows_.data() + (size - own) * kCholeskyBatch + lane;
      // Where the matrix is not positive definite, the diagonal has to do.
      const bool broken = !std::isfinite(row[(own - 1) * kCholeskyBatch]);
      for (std::size_t s = 0; s < own; ++s) {
        const double value = broken ? (s + 1 == own ? 1 : 0) : row[s * kCholeskyBatch];
        factor_.value[first + s] = static_cast<float>(value * root_[factor_.column[first + s]]);
      }
    }
  }

 private:
  struct Neighbor {
    float strength;
    std::uint32_t index;
  };

  std::size_t entries(std::size_t row) const {
    return factor_.row_begin[row + 1] - factor_.row_begin[row];
  }

  /// The first rows of a lane's matrix, where its pattern is smaller than others of the batch.
  void set_identity(std::size_t rows, std::size_t lane) {
    for (std::size_t i = 0; i < rows; ++i) {
      for (std::size_t j = 0; j < i; ++j) matrices_[batch_entry(i, j) + lane] = 0;
      matrices_[batch_entry(i, i) + lane] = 1;
    }
  }

  /// Of the unknowns before `row` those most strongly coupled to it, ascending, and `row` itself.
  void find_pattern(std::size_t row) {
    neighbors_.clear();
    const std::uint64_t end = matrix_.row_begin[row + 1] - 1;
    for (std::uint64_t entry = matrix_.row_begin[row]; entry < end; ++entry) {
      const std::uint32_t j = matrix_.column[entry];
      neighbors_.push_back({static_cast<float>(std::abs(matrix_.value[entry]) * root_[j]), j});
    }
    const std::size_t wanted = entries(row) - 1;
    if (neighbors_.size() > wanted) {
      const auto stronger = [](const Neighbor& a, const Neighbor& b) {
        return a.strength != b.strength ? a.strength > b.strength : a.index < b.index;
      };
      std::nth_element(neighbors_.begin(), neighbors_.begin() + static_cast<std::ptrdiff_t>(wanted),
                       neighbors_.end(), stronger);
    }
    std::uint32_t* pattern = factor_.column.data() + factor_.row_begin[row];
    for (std::size_t s = 0; s < wanted; ++s) pattern[s] = neighbors_[s].index;
    std::sort(pattern, pattern + wanted);
    pattern[wanted] = static_cast<std::uint32_t>(row);
  }

  /// The matrix' part of the pattern's rows and columns, scaled to a unit diagonal, as the last
  /// rows of a lane.
  void gather(std::size_t row, std::size_t offset, std::size_t lane) {
    const std::uint32_t* pattern = factor_.column.data() + factor_.row_begin[row];
    const std::size_t own = entries(row);
    for (std::size_t s = 0; s < own; ++s) {
      slot_[pattern[s]] = static_cast<std::uint8_t>(s + 1);
      slot_root_[s] = root_[pattern[s]];
    }
    for (std::size_t s = 0; s < own; ++s) {
      const std::uint32_t i = pattern[s];
      // Entries outside of the pattern go to slot 0: quicker than a branch that nothing foretells.
      const std::uint64_t end = matrix_.row_begin[i + 1] - 1;
      for (std::uint64_t entry = first_from(matrix_, i, pattern[0]); entry < end; ++entry) {
        slot_value_[slot_[matrix_.column[entry]]] = matrix_.value[entry];
      }
      double* out = matrices_.data() + batch_entry(offset + s, 0) + lane;
      for (std::size_t t = 0; t < offset; ++t) out[t * kCholeskyBatch] = 0;
      out += offset * kCholeskyBatch;
      for (std::size_t t = 0; t < s; ++t) {
        out[t * kCholeskyBatch] = slot_value_[t + 1] * slot_root_[s] * slot_root_[t];
        slot_value_[t + 1] = 0;
      }
      out[s * kCholeskyBatch] = 1;
    }
    for (std::size_t s = 0; s < own; ++s) slot_[pattern[s]] = 0;
  }

  const SymmetricMatrix& matrix_;
  const Array<double>& root_;
  SparseMatrixF& factor_;
  std::vector<Neighbor> neighbors_;
  Array<std::uint8_t> slot_;  ///< Of every unknown its place in the pattern, from 1 on, or 0.
  Array<double> slot_value_;  ///< Zero between rows, but for slot 0.
  Array<double> slot_root_;
  Array<double> matrices_;
  Array<double> rows_;
};

}  // namespace

InverseFactor::InverseFactor(SparseMatrixF factor)
    : factor_(std::move(factor)), transposed_(transposed(factor_)) {}

InverseFactor::InverseFactor(const SymmetricMatrix& matrix, Preconditioner kind)
    : InverseFactor(kind == Preconditioner::kJacobi ? jacobi(matrix) : sparse_inverse(matrix)) {}

InverseFactor InverseFactor::jacobi(const SymmetricMatrix& matrix) {
  const Array<double> root = inverse_roots(matrix);
  SparseMatrixF factor;
  factor.row_begin.resize(root.size() + 1);
  factor.column.resize(root.size());
  factor.value.resize(root.size());
  for (std::size_t i = 0; i < root.size(); ++i) {
    factor.row_begin[i] = i;
    factor.column[i] = static_cast<std::uint32_t>(i);
    factor.value[i] = static_cast<float>(root[i]);
  }
  factor.row_begin[root.size()] = root.size();
  return InverseFactor(std::move(factor));
}

std::size_t InverseFactor::default_row_entries(const SymmetricMatrix& matrix) {
  const std::size_t mean = matrix.entries() / std::max<std::size_t>(1, matrix.rows());
  return std::clamp<std::size_t>((mean + 3) / 4, 8, 40);
}

InverseFactor InverseFactor::sparse_inverse(const SymmetricMatrix& matrix,
                                            std::size_t row_entries) {
  const std::size_t n = matrix.rows();
  if (row_entries == 0) row_entries = default_row_entries(matrix);
  row_entries = std::min(row_entries, kMaxRowEntries);
  const Array<double> root = inverse_roots(matrix);
  SparseMatrixF factor;
  factor.row_begin.assign(n + 1, 0);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t own = matrix.row_begin[i + 1] - matrix.row_begin[i];
    factor.row_begin[i + 1] = factor.row_begin[i] + std::min(own, row_entries);
  }
  factor.column.resize(factor.row_begin[n]);
  factor.value.resize(factor.row_begin[n]);
  std::vector<std::unique_ptr<RowBuilder>> builders(static_cast<std::size_t>(thread_count()));
  parallel_for(n, kUnknownGrain, [&](std::size_t begin, std::size_t end, int worker) {
    std::unique_ptr<RowBuilder>& builder = builders[static_cast<std::size_t>(worker)];
    if (!builder) builder = std::make_unique<RowBuilder>(matrix, root, row_entries, factor);
    for (std::size_t row = begin; row < end; row += kCholeskyBatch) {
      builder->build(row, std::min(kCholeskyBatch, end - row));
    }
  });
  return InverseFactor(std::move(factor));
}

}  // namespace surfel
