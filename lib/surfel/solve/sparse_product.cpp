#include <algorithm>

#include <surfel/solve/sparse_product.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/solve/sparse_product.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kChannels = 4;

/// Sum over a row's entries; four sums run side by side, as an addition takes several cycles.
template <class T>
HWY_INLINE void multiply_row(const T* value, const std::uint32_t* column, std::size_t count,
                             const T* HWY_RESTRICT x, T* HWY_RESTRICT y) {
  const hn::CappedTag<T, kChannels> d;
  constexpr std::size_t kLanes = std::min(kChannels, hn::MaxLanes(d));
  constexpr std::size_t kParts = kChannels / kLanes;
  constexpr std::size_t kSums = 4;
  hn::Vec<decltype(d)> sum[kSums][kParts];
  for (auto& parts : sum) {
    for (auto& part : parts) part = hn::Zero(d);
  }
  const auto add = [&](std::size_t slot, std::size_t entry) HWY_ATTR {
    const T* from = x + kChannels * column[entry];
    const auto factor = hn::Set(d, value[entry]);
    for (std::size_t part = 0; part < kParts; ++part) {
      sum[slot][part] = hn::MulAdd(factor, hn::LoadU(d, from + part * kLanes), sum[slot][part]);
    }
  };
  std::size_t entry = 0;
  for (; entry + kSums <= count; entry += kSums) {
    for (std::size_t slot = 0; slot < kSums; ++slot) add(slot, entry + slot);
  }
  for (; entry < count; ++entry) add(0, entry);
  for (std::size_t part = 0; part < kParts; ++part) {
    hn::StoreU(hn::Add(hn::Add(sum[0][part], sum[1][part]), hn::Add(sum[2][part], sum[3][part])), d,
               y + part * kLanes);
  }
}

template <class T>
HWY_INLINE void multiply(const std::uint64_t* row_begin, const std::uint32_t* column,
                         const T* value, std::size_t begin, std::size_t end, const T* x, T* y) {
  for (std::size_t row = begin; row < end; ++row) {
    const std::uint64_t first = row_begin[row];
    multiply_row(value + first, column + first, row_begin[row + 1] - first, x,
                 y + kChannels * (row - begin));
  }
}

}  // namespace

void multiply_double(const SparseMatrix& matrix, std::size_t begin, std::size_t end,
                     const double* x, double* y) {
  multiply(matrix.row_begin.data(), matrix.column.data(), matrix.value.data(), begin, end, x, y);
}

void multiply_float(const SparseMatrixF& matrix, std::size_t begin, std::size_t end, const float* x,
                    float* y) {
  multiply(matrix.row_begin.data(), matrix.column.data(), matrix.value.data(), begin, end, x, y);
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(multiply_double);
HWY_EXPORT(multiply_float);

void multiply_rows(const SparseMatrix& matrix, std::size_t begin, std::size_t end,
                   const Channels* x, Channels* y) {
  if (begin == end) return;
  HWY_DYNAMIC_DISPATCH(multiply_double)(matrix, begin, end, x->data(), y->data());
}

void multiply_rows(const SparseMatrixF& matrix, std::size_t begin, std::size_t end,
                   const ChannelsF* x, ChannelsF* y) {
  if (begin == end) return;
  HWY_DYNAMIC_DISPATCH(multiply_float)(matrix, begin, end, x->data(), y->data());
}

double relative_residual(const SparseMatrix& matrix, const Array<Channels>& b,
                         const Array<Channels>& x) {
  Array<Channels> product(b.size());
  multiply_rows(matrix, 0, b.size(), x.data(), product.data());
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
