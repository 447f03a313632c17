#include <algorithm>

#include <surfel/base/parallel.h>
#include <surfel/solve/column_map.h>
#include <surfel/solve/range_sums.h>
#include <surfel/solve/symmetric_product.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/solve/symmetric_product.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kRowChannels = 4;  ///< Numbers of a Channels (sparse_matrix.h).
using RowTag = hn::CappedTag<double, kRowChannels>;
constexpr std::size_t kRowLanes = std::min(kRowChannels, hn::MaxLanes(RowTag()));
constexpr std::size_t kRowParts = kRowChannels / kRowLanes;
/// Sums side by side, as an addition takes several cycles.
constexpr std::size_t kSums = 2;

/// Unknown i, and the sums of its row.
struct Row {
  hn::Vec<RowTag> x[kRowParts];
  hn::Vec<RowTag> sum[kSums][kRowParts];
};

/// Entries [begin, end), of row i, both ways: adds a_ij x_j to the row's sums, and a_ij x_i to the
/// unknown that target(entry, j) points at.
template <class Target>
HWY_INLINE void add_entries(const SymmetricMatrix& matrix, std::uint64_t begin, std::uint64_t end,
                            const double* HWY_RESTRICT x, const Target& target, Row& row) {
  const RowTag d;
  const double* const value = matrix.value.data();
  const std::uint32_t* const column = matrix.column.data();
  const auto add = [&](std::size_t slot, std::uint64_t entry) HWY_ATTR {
    const std::size_t j = column[entry];
    const auto factor = hn::Set(d, value[entry]);
    double* to = target(entry, j);
    for (std::size_t part = 0; part < kRowParts; ++part) {
      const std::size_t lane = part * kRowLanes;
      hn::Vec<RowTag>& sum = row.sum[slot][part];
      sum = mul_add(factor, hn::LoadU(d, x + kRowChannels * j + lane), sum);
      hn::StoreU(mul_add(factor, row.x[part], hn::LoadU(d, to + lane)), d, to + lane);
    }
  };
  std::uint64_t entry = begin;
  for (; entry + kSums <= end; entry += kSums) {
    for (std::size_t slot = 0; slot < kSums; ++slot) add(slot, entry + slot);
  }
  for (; entry < end; ++entry) add(0, entry);
}

}  // namespace

/// Sets y in the range of rows from `begin` on to the sums of these rows' entries, and adds what
/// the entries add to rows before to the range's halo.
/// \param slot  place in the halo of the row of every entry before the range.
void multiply_range(const SymmetricMatrix& matrix, std::size_t begin, const std::uint32_t* slot,
                    const double* x, double* y, double* halo) {
  const RowTag d;
  const std::uint32_t* column = matrix.column.data();
  const std::size_t end = std::min(begin + SymmetricProduct::kRange, matrix.rows());
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint64_t first = matrix.row_begin[i];
    const std::uint64_t last = matrix.row_begin[i + 1] - 1;
    const auto inside =
        static_cast<std::uint64_t>(std::lower_bound(column + first, column + last, begin) - column);
    Row row;
    for (std::size_t part = 0; part < kRowParts; ++part) {
      row.x[part] = hn::LoadU(d, x + kRowChannels * i + part * kRowLanes);
      row.sum[0][part] = hn::Mul(hn::Set(d, matrix.value[last]), row.x[part]);
      for (std::size_t sum = 1; sum < kSums; ++sum) row.sum[sum][part] = hn::Zero(d);
    }
    const auto outside = [&](std::uint64_t entry, std::size_t) {
      return halo + kRowChannels * slot[entry - first];
    };
    const auto own = [&](std::uint64_t, std::size_t j) { return y + kRowChannels * j; };
    add_entries(matrix, first, inside, x, outside, row);
    add_entries(matrix, inside, last, x, own, row);
    slot += inside - first;
    for (std::size_t part = 0; part < kRowParts; ++part) {
      hn::StoreU(hn::Add(row.sum[0][part], row.sum[1][part]), d,
                 y + kRowChannels * i + part * kRowLanes);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(multiply_range);

SymmetricProduct::SymmetricProduct(const SymmetricMatrix& matrix)
    : matrix_(matrix), halo_((matrix.rows() + kRange - 1) / kRange) {
  parallel_for(halo_.size(), 1, [&](std::size_t r, std::size_t, int) { halo_[r] = find_halo(r); });
  std::uint64_t sums = 0;
  for (Halo& halo : halo_) {
    halo.first_sum = sums;
    sums += halo.row.size();
  }
  halo_sum_.resize(sums);
  incoming_ = group_by_key<std::uint64_t>(matrix.rows(), [&](const auto& add) {
    for (const Halo& halo : halo_) {
      for (std::size_t h = 0; h < halo.row.size(); ++h) add(halo.row[h], halo.first_sum + h);
    }
  });
}

SymmetricProduct::Halo SymmetricProduct::find_halo(std::size_t range) const {
  Halo halo;
  ColumnMap rows;
  const std::size_t begin = range * kRange;
  const std::size_t end = std::min(begin + kRange, matrix_.rows());
  for (std::size_t row = begin; row < end; ++row) {
    for (std::uint64_t e = matrix_.row_begin[row]; matrix_.column[e] < begin; ++e) {
      halo.slot.push_back(rows.number(matrix_.column[e]));
    }
  }
  halo.slot.shrink_to_fit();
  halo.row.assign(rows.columns().begin(), rows.columns().end());
  return halo;
}

void SymmetricProduct::multiply(const Array<Channels>& x, Array<Channels>& y) {
  parallel_for(halo_.size(), 1, [&](std::size_t r, std::size_t, int) {
    const Halo& halo = halo_[r];
    Channels* const sums = halo_sum_.data() + halo.first_sum;
    std::fill_n(sums, halo.row.size(), Channels::Zero());
    HWY_DYNAMIC_DISPATCH(multiply_range)
    (matrix_, r * kRange, halo.slot.data(), reinterpret_cast<const double*>(x.data()),
     reinterpret_cast<double*>(y.data()), reinterpret_cast<double*>(sums));
  });
  parallel_for(matrix_.rows(), kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t j = begin; j < end; ++j) {
      for (std::uint64_t i = incoming_.begin[j]; i < incoming_.begin[j + 1]; ++i) {
        y[j] += halo_sum_[incoming_.item[i]];
      }
    }
  });
}

double relative_residual(const SymmetricMatrix& matrix, const Array<Channels>& b,
                         const Array<Channels>& x) {
  Array<Channels> product(b.size());
  SymmetricProduct(matrix).multiply(x, product);
  Channels error2 = Channels::Zero();
  Channels norm2 = Channels::Zero();
  for (std::size_t i = 0; i < b.size(); ++i) {
    error2 += (b[i] - product[i]).square();
    norm2 += b[i].square();
  }
  return (norm2 > 0).select(error2 / norm2, 0).sqrt().maxCoeff();
}

}  // namespace surfel
#endif
