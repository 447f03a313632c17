#include <algorithm>

#include <surfel/base/parallel.h>
#include <surfel/solve/range_sums.h>
#include <surfel/solve/symmetric_product.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/solve/symmetric_product.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kChannels = 4;
using Tag = hn::CappedTag<double, kChannels>;
constexpr std::size_t kLanes = std::min(kChannels, hn::MaxLanes(Tag()));
constexpr std::size_t kParts = kChannels / kLanes;
/// Sums side by side, as an addition takes several cycles.
constexpr std::size_t kSums = 2;

/// Unknown i, and the sums of its row.
struct Row {
  hn::Vec<Tag> x[kParts];
  hn::Vec<Tag> sum[kSums][kParts];
};

/// Entries [begin, end), of row i, both ways: adds a_ij x_j to the row's sums, and a_ij x_i to the
/// unknown that target(j) points at.
template <class Target>
HWY_INLINE void add_entries(const SymmetricMatrix& matrix, std::uint64_t begin, std::uint64_t end,
                            const double* HWY_RESTRICT x, const Target& target, Row& row) {
  const Tag d;
  const double* const value = matrix.value.data();
  const std::uint32_t* const column = matrix.column.data();
  const auto add = [&](std::size_t slot, std::uint64_t entry) HWY_ATTR {
    const std::size_t j = column[entry];
    const auto factor = hn::Set(d, value[entry]);
    double* to = target(j);
    for (std::size_t part = 0; part < kParts; ++part) {
      const std::size_t lane = part * kLanes;
      hn::Vec<Tag>& sum = row.sum[slot][part];
      sum = hn::MulAdd(factor, hn::LoadU(d, x + kChannels * j + lane), sum);
      hn::StoreU(hn::MulAdd(factor, row.x[part], hn::LoadU(d, to + lane)), d, to + lane);
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
void multiply_range(const SymmetricMatrix& matrix, std::size_t begin, const std::uint32_t* slot,
                    const double* x, double* y, double* halo) {
  const Tag d;
  const std::uint32_t* column = matrix.column.data();
  const std::size_t end = std::min(begin + SymmetricProduct::kRange, matrix.rows());
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint64_t first = matrix.row_begin[i];
    const std::uint64_t last = matrix.row_begin[i + 1] - 1;
    const auto inside =
        static_cast<std::uint64_t>(std::lower_bound(column + first, column + last, begin) - column);
    Row row;
    for (std::size_t part = 0; part < kParts; ++part) {
      row.x[part] = hn::LoadU(d, x + kChannels * i + part * kLanes);
      row.sum[0][part] = hn::Mul(hn::Set(d, matrix.value[last]), row.x[part]);
      for (std::size_t sum = 1; sum < kSums; ++sum) row.sum[sum][part] = hn::Zero(d);
    }
    add_entries(
        matrix, first, inside, x, [&](std::size_t j) { return halo + kChannels * slot[j]; }, row);
    add_entries(
        matrix, inside, last, x, [&](std::size_t j) { return y + kChannels * j; }, row);
    for (std::size_t part = 0; part < kParts; ++part) {
      hn::StoreU(hn::Add(row.sum[0][part], row.sum[1][part]), d, y + kChannels * i + part * kLanes);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

constexpr std::uint32_t kNone = static_cast<std::uint32_t>(-1);

}  // namespace

HWY_EXPORT(multiply_range);

SymmetricProduct::SymmetricProduct(const SymmetricMatrix& matrix) : matrix_(matrix) {
  const std::size_t rows = matrix.rows();
  halo_.resize((rows + kRange - 1) / kRange);
  find_halos();
  halo_begin_.push_back(0);
  for (const auto& halo : halo_) halo_begin_.push_back(halo_begin_.back() + halo.size());
  halo_sum_.resize(halo_begin_.back());
  incoming_begin_.assign(rows + 1, 0);
  for (const auto& halo : halo_) {
    for (const std::uint32_t j : halo) ++incoming_begin_[j + 1];
  }
  for (std::size_t j = 0; j < rows; ++j) incoming_begin_[j + 1] += incoming_begin_[j];
  incoming_.resize(halo_begin_.back());
  Array<std::uint64_t> next = incoming_begin_;
  std::uint64_t sum = 0;
  for (const auto& halo : halo_) {
    for (const std::uint32_t j : halo) incoming_[next[j]++] = sum++;
  }
}

void SymmetricProduct::find_halos() {
  parallel_for(halo_.size(), 1, [&](std::size_t r, std::size_t, int worker) {
    Array<std::uint32_t>& slot = slot_[worker];
    if (slot.empty()) slot.assign(matrix_.rows(), kNone);
    const std::size_t begin = r * kRange;
    const std::size_t end = std::min(begin + kRange, matrix_.rows());
    for (std::size_t row = begin; row < end; ++row) {
      for (std::uint64_t e = matrix_.row_begin[row]; matrix_.column[e] < begin; ++e) {
        if (slot[matrix_.column[e]] != kNone) continue;
        slot[matrix_.column[e]] = 0;
        halo_[r].push_back(matrix_.column[e]);
      }
    }
    for (const std::uint32_t j : halo_[r]) slot[j] = kNone;
    halo_[r].shrink_to_fit();
  });
}

void SymmetricProduct::multiply(const Array<Channels>& x, Array<Channels>& y) {
  parallel_for(halo_.size(), 1, [&](std::size_t r, std::size_t, int worker) {
    Array<std::uint32_t>& slot = slot_[worker];
    if (slot.empty()) slot.resize(matrix_.rows());
    Channels* sums = halo_sum_.data() + halo_begin_[r];
    for (std::size_t h = 0; h < halo_[r].size(); ++h) {
      slot[halo_[r][h]] = static_cast<std::uint32_t>(h);
      sums[h].setZero();
    }
    const std::size_t begin = r * kRange;
    HWY_DYNAMIC_DISPATCH(multiply_range)
    (matrix_, begin, slot.data(), reinterpret_cast<const double*>(x.data()),
     reinterpret_cast<double*>(y.data()), reinterpret_cast<double*>(sums));
  });
  parallel_for(matrix_.rows(), kUnknownGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t j = begin; j < end; ++j) {
      for (std::uint64_t i = incoming_begin_[j]; i < incoming_begin_[j + 1]; ++i) {
        y[j] += halo_sum_[incoming_[i]];
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
