// Kolotilina, Yeremin 1993, "Factorized sparse approximate inverse preconditionings I" (the
// method). Kaporin 1994, "New convergence results and preconditioning strategies for the conjugate
// gradient method" (what it minimises). Schaefer, Katzfuss, Owhadi 2021, "Sparse Cholesky
// factorization by Kullback-Leibler minimization" (the same factor, for Gram matrices of kernels).

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/solve/batch_cholesky.h>
#include <surfel/solve/column_map.h>
#include <surfel/solve/inverse_factor.h>
#include <surfel/solve/range_sums.h>

namespace surfel {
namespace {

constexpr std::size_t kMaxRowEntries = 240;  ///< With a block more, places fit into a byte.
constexpr std::size_t kBlockGrain = 64;      ///< Blocks that one thread works on at a time.
static_assert(kBlockGrain % kCholeskyBatch == 0 && kUnknownGrain % kBlockRows == 0);

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

std::size_t default_row_entries(const SymmetricMatrix& matrix) {
  const std::size_t mean = matrix.entries() / std::max<std::size_t>(1, matrix.rows());
  return std::clamp<std::size_t>(mean / 3, 8, 64);
}

/// Places of a pattern's columns, from 1 on, and 0 for all other columns, without a branch that
/// nothing foretells: bytes in pages of columns that follow each other, of which only pages of the
/// pattern are stored, in a table without collisions.
class PatternPlaces {
 public:
  /// \param pattern  at most 255 columns.
  void set(std::span<const std::uint32_t> pattern) {
    while (!fill(pattern)) table_.resize(2 * table_.size());
  }
  std::uint8_t operator[](std::uint32_t column) const {
    const Page& page = table_[column / kColumns & (table_.size() - 1)];
    return place_[(page.number == column / kColumns ? page.begin : 0) + column % kColumns];
  }

 private:
  /// Columns of a page: its bytes are half a cache line.
  static constexpr std::uint32_t kColumns = 32;
  static constexpr std::uint32_t kNoPage = static_cast<std::uint32_t>(-1);
  struct Page {
    std::uint32_t number;
    std::uint32_t begin;  ///< First place in place_.
  };

  /// \return false where two pages collide.
  bool fill(std::span<const std::uint32_t> pattern) {
    std::fill(table_.begin(), table_.end(), Page{kNoPage, 0});
    place_.assign(kColumns, 0);  // The page of columns without a place.
    for (std::size_t s = 0; s < pattern.size(); ++s) {
      const std::uint32_t number = pattern[s] / kColumns;
      Page& page = table_[number & (table_.size() - 1)];
      if (page.number != number) {
        if (page.number != kNoPage) return false;
        page = {number, static_cast<std::uint32_t>(place_.size())};
        place_.resize(place_.size() + kColumns, 0);
      }
      place_[page.begin + pattern[s] % kColumns] = static_cast<std::uint8_t>(s + 1);
    }
    return true;
  }

  std::vector<Page> table_ = std::vector<Page>(128);  ///< A power of two; most patterns fit in.
  std::vector<std::uint8_t> place_;
};

/// Fills in the blocks of a factor; every thread has its own builder.
class BlockBuilder {
 public:
  /// \param before  unknowns before a block that its rows may couple with, at most.
  BlockBuilder(const SymmetricMatrix& matrix, const Array<double>& root, std::size_t before)
      : matrix_(matrix), root_(root), before_(before) {
    const std::size_t size = before + kBlockRows;
    slot_value_.assign(size + 1, 0);
    slot_root_.resize(size);
    matrices_.resize(batch_entry(size, 0));
    rows_.resize(size * kBlockRows * kCholeskyBatch);
  }

  /// The unknowns before a block that are most strongly coupled to any of its rows, ascending.
  /// Valid until the next call.
  std::span<const std::uint32_t> find_pattern(std::size_t block) {
    neighbors_.clear();
    map_.clear();
    const std::size_t first = block * kBlockRows;
    const std::size_t end = std::min(first + kBlockRows, matrix_.rows());
    for (std::size_t row = first; row < end; ++row) {
      for (std::uint64_t entry = matrix_.row_begin[row]; matrix_.column[entry] < first; ++entry) {
        const std::uint32_t j = matrix_.column[entry];
        const auto strength =
            static_cast<float>(std::abs(matrix_.value[entry]) * root_[j] * root_[row]);
        const std::uint32_t place = map_.number(j);
        if (place == neighbors_.size()) neighbors_.push_back({strength, j});
        float& strongest = neighbors_[place].strength;
        strongest = std::max(strongest, strength);
      }
    }
    if (neighbors_.size() > before_) {
      const auto stronger = [](const Neighbor& a, const Neighbor& b) {
        return a.strength != b.strength ? a.strength > b.strength : a.index < b.index;
      };
      std::nth_element(neighbors_.begin(),
                       neighbors_.begin() + static_cast<std::ptrdiff_t>(before_), neighbors_.end(),
                       stronger);
      neighbors_.resize(before_);
    }
    pattern_.clear();
    for (const Neighbor& neighbor : neighbors_) pattern_.push_back(neighbor.index);
    std::sort(pattern_.begin(), pattern_.end());
    return pattern_;
  }

  /// The values of blocks [begin, begin + count), at most kCholeskyBatch, whose columns are set.
  void build(BlockMatrixF& factor, std::size_t begin, std::size_t count) {
    std::size_t size = kBlockRows;
    for (std::size_t block = begin; block < begin + count; ++block) {
      size = std::max(size, columns_of(factor, block).size());
    }
    for (std::size_t lane = 0; lane < kCholeskyBatch; ++lane) {
      if (lane < count) {
        gather(columns_of(factor, begin + lane), size, lane);
      } else {
        set_identity(size, lane);
      }
    }
    last_inverse_rows(size, kBlockRows, matrices_.data(), rows_.data());
    for (std::size_t lane = 0; lane < count; ++lane) write(factor, begin + lane, size, lane);
  }

 private:
  struct Neighbor {
    float strength;
    std::uint32_t index;
  };

  static std::span<const std::uint32_t> columns_of(const BlockMatrixF& factor, std::size_t block) {
    const std::uint64_t begin = factor.block_begin[block];
    return {factor.column.data() + begin, factor.block_begin[block + 1] - begin};
  }

  /// The first rows of a lane's matrix, where its pattern is smaller than others of the batch.
  void set_identity(std::size_t rows, std::size_t lane) {
    for (std::size_t i = 0; i < rows; ++i) {
      for (std::size_t j = 0; j < i; ++j) matrices_[batch_entry(i, j) + lane] = 0;
      matrices_[batch_entry(i, i) + lane] = 1;
    }
  }

  /// The matrix' part of the pattern's rows and columns, scaled to a unit diagonal, as the last
  /// rows of a lane of `size` rows.
  void gather(std::span<const std::uint32_t> pattern, std::size_t size, std::size_t lane) {
    const std::size_t own = pattern.size();
    const std::size_t offset = size - own;
    set_identity(offset, lane);
    places_.set(pattern);
    for (std::size_t s = 0; s < own; ++s) slot_root_[s] = root_[pattern[s]];
    for (std::size_t s = 0; s < own; ++s) {
      const std::uint32_t i = pattern[s];
      // Entries outside of the pattern go to slot 0.
      const std::uint64_t end = matrix_.row_begin[i + 1] - 1;
      for (std::uint64_t entry = first_from(matrix_, i, pattern[0]); entry < end; ++entry) {
        slot_value_[places_[matrix_.column[entry]]] = matrix_.value[entry];
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
  }

  /// A block's rows, the last of L^-1, scaled back.
  void write(BlockMatrixF& factor, std::size_t block, std::size_t size, std::size_t lane) const {
    const std::span<const std::uint32_t> pattern = columns_of(factor, block);
    const std::size_t rows = factor.rows_of(block);
    const std::size_t before = pattern.size() - rows;
    float* value = factor.value.data() + factor.block_begin[block] * kBlockRows;
    std::fill_n(value, pattern.size() * kBlockRows, 0.0F);
    for (std::size_t r = 0; r < rows; ++r) {
      const double* row =
          rows_.data() + ((kBlockRows - rows + r) * size + size - pattern.size()) * kCholeskyBatch +
          lane;
      const std::size_t diagonal = before + r;
      // Where the matrix is not positive definite, the row is the diagonal alone.
      const bool broken = !std::isfinite(row[diagonal * kCholeskyBatch]);
      for (std::size_t s = broken ? diagonal : 0; s <= diagonal; ++s) {
        const double entry = broken ? 1 : row[s * kCholeskyBatch];
        value[s * kBlockRows + r] = static_cast<float>(entry * root_[pattern[s]]);
      }
    }
  }

  const SymmetricMatrix& matrix_;
  const Array<double>& root_;
  std::size_t before_;
  std::vector<Neighbor> neighbors_;
  std::vector<std::uint32_t> pattern_;
  ColumnMap map_;  ///< Places in neighbors_.
  PatternPlaces places_;
  Array<double> slot_value_;  ///< By place in the pattern; zero between rows, except [0].
  Array<double> slot_root_;
  Array<double> matrices_;
  Array<double> rows_;
};

/// A factor whose blocks couple their own rows and the unknowns before(block).
template <class Before>
void set_columns(BlockMatrixF& factor, const Before& before) {
  factor.block_begin.assign(factor.blocks() + 1, 0);
  for (std::size_t b = 0; b < factor.blocks(); ++b) {
    factor.block_begin[b + 1] = factor.block_begin[b] + before(b).size() + factor.rows_of(b);
  }
  factor.column.resize(factor.block_begin.back());
  factor.value.resize(factor.column.size() * kBlockRows);
  for (std::size_t b = 0; b < factor.blocks(); ++b) {
    const std::span<const std::uint32_t> columns = before(b);
    std::uint32_t* out =
        std::copy(columns.begin(), columns.end(), factor.column.data() + factor.block_begin[b]);
    std::iota(out, out + factor.rows_of(b), static_cast<std::uint32_t>(b * kBlockRows));
  }
}

}  // namespace

InverseFactor::InverseFactor(const SymmetricMatrix& matrix, std::size_t row_entries) {
  if (row_entries == 0) row_entries = default_row_entries(matrix);
  // A row has half of its own block's entries on average.
  const std::size_t before =
      std::clamp(row_entries, kBlockRows / 2, kMaxRowEntries) - kBlockRows / 2;
  const Array<double> root = inverse_roots(matrix);
  factor_.rows = matrix.rows();
  PerWorker<BlockBuilder> builders(
      [&] { return std::make_unique<BlockBuilder>(matrix, root, before); });
  Array<std::uint32_t> pattern(factor_.blocks() * before);
  Array<std::uint32_t> found(factor_.blocks());
  parallel_for(factor_.blocks(), kBlockGrain, [&](std::size_t begin, std::size_t end, int worker) {
    for (std::size_t b = begin; b < end; ++b) {
      const std::span<const std::uint32_t> columns = builders[worker].find_pattern(b);
      found[b] = static_cast<std::uint32_t>(columns.size());
      std::copy(columns.begin(), columns.end(),
                pattern.begin() + static_cast<std::ptrdiff_t>(b * before));
    }
  });
  set_columns(factor_, [&](std::size_t b) {
    return std::span<const std::uint32_t>(pattern.data() + b * before, found[b]);
  });
  parallel_for(factor_.blocks(), kBlockGrain, [&](std::size_t begin, std::size_t end, int worker) {
    for (std::size_t b = begin; b < end; b += kCholeskyBatch) {
      builders[worker].build(factor_, b, std::min(kCholeskyBatch, end - b));
    }
  });
  factor_.list_places();
}

}  // namespace surfel
